//! The reader as an operation.
//!
//! A head of 16 bytes (`M425`, number of frames, a constant 6, number of molecules), then 18
//! values of four bytes a molecule, then what the program keeps for itself.

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_import::MappingParams;
use puncta_shared_records::names::{self, Raw};
use puncta_shared_records::{Field, Number, Opened, Pass, Source, damaged, fill, not_mine, open};

const PORT: &str = "localisations";
const MAGIC: &[u8] = b"M425";
const HEAD: usize = 16;
const RECORD: usize = 72;
const EXAMPLE: &[u8] = include_bytes!("../data/example.bin");

/// Name in the program, the host's name, whether it is a float, the unit (`px` for pixels), and
/// the meaning.
type Known = (&'static str, &'static str, bool, &'static str, &'static str);

const FIELDS: [Known; 18] = [
    ("x", "x_raw", true, "px", "Position as it was fitted"),
    ("y", "y_raw", true, "px", "Position as it was fitted"),
    ("xc", "x", true, "px", "Position, corrected for drift"),
    ("yc", "y", true, "px", "Position, corrected for drift"),
    ("h", "height", true, "", "Height of the spot"),
    ("a", "A", true, "", "Area under the spot"),
    ("w", "width", true, "nm", "Width of the spot"),
    ("phi", "phi", true, "", "Angle of the spot"),
    (
        "ax",
        "aspect",
        true,
        "1",
        "Width along y over width along x",
    ),
    ("bg", "background", true, "", "Background"),
    (
        "i",
        "intensity",
        true,
        "unknown",
        "Sum of the spot's pixels",
    ),
    ("c", "category", false, "1", "Category; 9 is not specific"),
    (
        "fi",
        "fit_status",
        false,
        "1",
        "Iterations or state of the fit",
    ),
    ("fr", "t", false, "frame", "Frame number, from 0"),
    (
        "tl",
        "track_length",
        false,
        "frame",
        "Frames of the molecule",
    ),
    (
        "lk",
        "link",
        false,
        "1",
        "Number of the next one of the molecule, or -1",
    ),
    ("z", "z_raw", true, "nm", "Position as it was fitted"),
    ("zc", "z", true, "nm", "Position, corrected for drift"),
];

/// Reads localisations from an Insight3 molecule list.
#[derive(Debug, Params)]
pub struct ReadInsight3 {
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

impl ReadInsight3 {
    fn fields(&self, file: &str) -> Result<(Vec<Field>, Vec<String>), Failure> {
        let (mut raw, mut fields) = (Vec::new(), Vec::new());
        for (i, (source, name, float, unit, text)) in FIELDS.iter().enumerate() {
            let number = if *float { Number::F32 } else { Number::I32 };
            let one = Raw::new(source, name, unit, number.element()).described(text);
            raw.push(if *name == "t" { one.from_one() } else { one });
            let info = ColumnInfo::new(*source, number.element(), "");
            fields.push(Field::new(info, number.little(), 4 * i));
        }
        names::fields(file, &self.mapping.mapping()?, &raw, &fields)
    }
}

/// The file, the frames and the molecules that it announces.
fn look(request: &Request) -> Result<(Opened, u32, u64), Failure> {
    let opened = open(request, HEAD)?;
    let name = &opened.name;
    if !opened.head.starts_with(MAGIC) {
        return Err(not_mine(name, "Insight3 molecule list"));
    }
    let (words, _) = opened.head.as_chunks::<4>();
    let [_, frames, _, molecules] = *words else {
        return Err(damaged(format!("{name} ends within its head")));
    };
    let rows = u64::from(u32::from_le_bytes(molecules));
    if rows * RECORD as u64 > opened.length.saturating_sub(HEAD as u64) {
        let message = format!("{name} ends before the {rows} molecules that it announces");
        return Err(damaged(message));
    }
    Ok((opened, u32::from_le_bytes(frames), rows))
}

fn header(fields: &[Field], frames: u32, rows: u64) -> Header {
    let infos = fields.iter().map(|field| field.info.clone());
    let mut header = Header::table(PORT, rows, infos.collect());
    header
        .metadata
        .insert("format".into(), "Insight3 bin".into());
    header
        .metadata
        .insert("camera".into(), json!({ "frames": frames }));
    header
}

impl Operation for ReadInsight3 {
    const ID: &'static str = "puncta.insight3.read/1";

    fn info() -> Info {
        Info::reader("Insight3 molecule lists", &[".bin"])
            .description(
                "Reads localisations from Insight3 molecule lists, which storm-analysis writes, \
                 too.\nPositions are in camera pixels, which become nm with pixel_size; z is in \
                 nm. Frames count from 0.",
            )
            .formats(&[MAGIC], &["Insight3 bin"])
            .output(Ports::table(PORT).description("One row a molecule."))
            .example(json!({ "pixel_size": 160 }))
            .example_bytes("example.bin", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let (opened, frames, rows) = look(request)?;
        let (fields, notes) = self.fields(&opened.name)?;
        let mut plan = Plan {
            interruptible: true,
            memory: 32 << 20,
            notes,
            ..Plan::default()
        };
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header: header(&fields, frames, rows),
        });
        plan.probe = Some(Probe {
            format: "Insight3 bin".into(),
            confidence: 1.0,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (opened, frames, rows) = look(job.request())?;
        let (fields, _) = self.fields(&opened.name)?;
        let mut out = job.begin(PORT, header(&fields, frames, rows))?;
        let committer = out.committer();
        let pass = Pass {
            name: &opened.name,
            rows,
            record: RECORD,
            fields: &fields,
            select: None,
        };
        let source = Source::File(&opened.file, HEAD as u64);
        let mut commit = |rows| committer.commit(0, rows);
        fill(source, &pass, &mut out.columns_mut(0)?, &mut commit, job)?;
        out.finish()
    }
}
