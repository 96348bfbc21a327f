//! The writer of Picasso's `.hdf5` with its `.yaml`.

use std::path::Path;

use puncta_sdk::Input;
use puncta_sdk::input::ColumnRef;
use puncta_sdk::prelude::*;
use serde_json::{Value, json};

use crate::write_pyme::{plan, warn_left_out};
use crate::write_records::{Field, Stored, create, failed, write};

/// Our name, Picasso's, how it is stored, and whether Picasso counts camera pixels.
const FIELDS: [(&str, &str, Stored, bool); 11] = [
    ("t", "frame", Stored::U32, false),
    ("x", "x", Stored::F32, true),
    ("y", "y", Stored::F32, true),
    ("z", "z", Stored::F32, false),
    ("nPhotons", "photons", Stored::F32, false),
    ("sigx", "sx", Stored::F32, true),
    ("sigy", "sy", Stored::F32, true),
    ("background", "bg", Stored::F32, false),
    ("error_x", "lpx", Stored::F32, true),
    ("error_y", "lpy", Stored::F32, true),
    ("error_z", "lpz", Stored::F32, false),
];
/// Without these Picasso refuses a file.
const NEEDED: [(&str, &str); 5] = [
    ("t", "frame"),
    ("x", "nm"),
    ("y", "nm"),
    ("error_x", "nm"),
    ("error_y", "nm"),
];

/// Writes localisations as Picasso's `.hdf5` with its `.yaml`.
#[derive(Debug, Params)]
pub struct WritePicasso {
    /// Camera pixel; without it, that of the camera the localisations came from.
    #[param(min = 0.001, max = 1e6, unit = "nm")]
    pixel_size: Option<f64>,
    /// Camera width; without it, that of the camera, or as far as the localisations reach.
    #[param(min = 1.0, max = 1e6, unit = "1")]
    width: Option<f64>,
    /// Camera height; without it, that of the camera, or as far as the localisations reach.
    #[param(min = 1.0, max = 1e6, unit = "1")]
    height: Option<f64>,
}

impl WritePicasso {
    fn pixel(&self, header: &Header) -> Result<f64, Failure> {
        let own = header
            .metadata
            .get("camera")
            .and_then(|c| c.get("pixel_size_nm"));
        let size = self
            .pixel_size
            .or(own.and_then(Value::as_f64))
            .filter(|s| *s > 0.0);
        size.ok_or_else(|| {
            let message = "Picasso counts camera pixels, and the table does not say their size";
            Failure::bad_parameter("pixel_size", message)
                .remedy("give --out-pixel_size SIZE, such as --out-pixel_size 130nm")
        })
    }

    /// Width, height and number of frames of the camera.
    fn camera(&self, input: &Input<'_>, pixel: f64) -> Result<[u64; 3], Failure> {
        let known = |key: &str| {
            let camera = input.header().metadata.get("camera")?;
            camera.get(key)?.as_f64().filter(|v| *v >= 1.0)
        };
        let reach = |column: &str| -> Result<f64, Failure> {
            let values = input.f64(column)?;
            let top = values
                .iter()
                .copied()
                .filter(|v| v.is_finite())
                .fold(0.0, f64::max);
            Ok(top)
        };
        let width = match self.width.or(known("width_px")) {
            Some(width) => width,
            None => (reach("x")? / pixel).floor() + 1.0,
        };
        let height = match self.height.or(known("height_px")) {
            Some(height) => height,
            None => (reach("y")? / pixel).floor() + 1.0,
        };
        let frames = match known("frames") {
            Some(frames) => frames,
            None => reach("t")? + 1.0,
        };
        Ok([width as u64, height as u64, frames as u64])
    }
}

impl Operation for WritePicasso {
    const ID: &'static str = "puncta.hdf5.picasso.write/1";

    fn info() -> Info {
        let port = NEEDED
            .iter()
            .fold(Ports::table("table"), |port, (name, unit)| {
                port.column(name, unit)
            });
        Info::writer("Picasso localisations", &[".hdf5"])
            .description(
                "Writes localisations as Picasso lays them out: records in /locs with lengths in \
                 camera pixels, and a .yaml of the same name with the camera and every step. \
                 Picasso keeps 32 bits of a number.",
            )
            .input(port.description("Needs t, x, y, error_x and error_y."))
            .cite("10.1038/nprot.2017.024")
            .example(json!({ "pixel_size": 100 }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let plan = plan(request)?;
        if let Some(input) = request.inputs.first() {
            self.pixel(&input.header)?;
        }
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let path = Path::new(&job.file()?.path);
        let input = job.input("table")?;
        let header = input.header();
        let pixel = self.pixel(header)?;
        let infos = header.parts.first().map_or(&[][..], |part| &part.columns);
        let mut fields = Vec::new();
        let mut left_out = Vec::new();
        for (name, theirs, stored, pixels) in FIELDS {
            let Some(info) = infos.iter().find(|info| info.name == name) else {
                continue;
            };
            let nm = info.unit == "nm";
            let length = pixels || matches!(name, "z" | "error_z");
            if length && !nm {
                left_out.push(name);
                continue;
            }
            let factor = if pixels { 1.0 / pixel } else { 1.0 };
            fields.push(Field::new(theirs, input.column(0, name)?, stored, factor));
        }
        for info in infos {
            let known = FIELDS.iter().any(|(name, ..)| *name == info.name);
            let taken = |f: &Field<'_>| f.name == info.name;
            if known || fields.iter().any(taken) {
                continue;
            }
            let values = input.column(0, &info.name)?;
            let number = !matches!(values, ColumnRef::Utf8(_)) && Field::fits(values);
            if !number || info.type_.width != 1 {
                left_out.push(&info.name);
                continue;
            }
            let stored = match values {
                ColumnRef::F64(_) => Stored::F32,
                _ => Stored::Same,
            };
            fields.push(Field::new(&info.name, values, stored, 1.0));
        }
        warn_left_out(job, &left_out);
        let file = create(path)?;
        write(&file, "locs", &fields, input.rows(), job)?;
        file.close().map_err(|e| failed("the file", &e))?;
        let [width, height, frames] = self.camera(&input, pixel)?;
        let documents = documents(header, [width, height, frames], pixel);
        let yaml = path.with_extension("yaml");
        std::fs::write(&yaml, documents).map_err(|e| Failure::io("write", &yaml, &e))
    }
}

/// The steps so far, and ours; each value is JSON, which is YAML too.
fn documents(header: &Header, camera: [u64; 3], pixel: f64) -> String {
    let steps = header.metadata.get("picasso").and_then(Value::as_array);
    let mut documents: Vec<Value> = steps.cloned().unwrap_or_default();
    let [width, height, frames] = camera;
    if documents.is_empty() {
        documents.push(json!({
            "Width": width, "Height": height, "Frames": frames, "Pixelsize": pixel,
            "Byte Order": "<", "Data Type": "uint16",
        }));
    }
    documents.push(json!({
        "Generated by": concat!("Puncta ", env!("CARGO_PKG_VERSION"), " Export"),
        "Width": width, "Height": height, "Frames": frames, "Pixelsize": pixel,
    }));
    let text = |document: &Value| -> String {
        let entries = document.as_object().into_iter().flatten();
        entries
            .map(|(key, value)| format!("{}: {value}\n", Value::from(key.as_str())))
            .collect()
    };
    documents.iter().map(text).collect::<Vec<_>>().join("---\n")
}

register!(WritePicasso);
