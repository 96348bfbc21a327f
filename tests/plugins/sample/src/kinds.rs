//! One call that gives all five kinds of object and all types of column.

use puncta_sdk::documents::call::Read;
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::{ColumnMut, Figure, Series, serde_json::json};

/// Gives all five kinds of object.
#[derive(Params)]
struct AllKinds {
    /// Whether to leave the image unfinished.
    #[param(default = false)]
    forget: bool,
}

const TEXTS: [&str; 3] = ["alpha", "", "\u{3b3}amma"];

impl Operation for AllKinds {
    const ID: &'static str = "test.all-kinds/1";

    fn info() -> Info {
        Info::operation("All kinds")
            .output(Ports::table("table"))
            .output(Ports::image("image"))
            .output(Ports::mesh("mesh"))
            .output(Ports::figure("figure"))
            .output(Ports::report("report"))
            .example(json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        table(job)?;
        image(job, self.forget)?;
        mesh(job)?;
        let series = Series::numbers("curve", "line", &[0.0, 1.0], &[2.0, 3.0]);
        let figure = Figure::new("figure", "A curve", ["r", "nm"], ["K", "nm^2"]).with(series);
        let columns = Series::columns("columns", "points", "table", "i16", "f32");
        job.figure(&figure.with(columns))?;
        let mut report = Report::new("report");
        report.number("answer", f64::INFINITY, "nm").interval = Some([json!(1), json!(2)]);
        job.report(&report)
    }
}

fn table(job: &Job) -> Result<(), Failure> {
    let columns = vec![
        ColumnInfo::new("u8", Element::U8, "1"),
        ColumnInfo::new("i16", Element::I16, "1"),
        ColumnInfo::new("i64", Element::I64, "1"),
        ColumnInfo::new("f32", Element::F32, "photon"),
        ColumnInfo::new("vector", Element::F32, "nm")
            .width(3)
            .role("vector"),
        ColumnInfo::new("flag", Element::Bool, "1"),
        ColumnInfo::new("text", Element::Utf8, "1").text_bytes(64),
        {
            let mut column = ColumnInfo::new("name", Element::Dictionary, "1").text_bytes(64);
            column.entries = Some(3);
            column
        },
    ];
    let mut out = job.begin("table", Header::table("table", 4, columns))?;
    for column in out.columns_mut(0)? {
        match column {
            ColumnMut::U8(values) => values.copy_from_slice(&[1, 2, 3, 4]),
            ColumnMut::I16(values) => values.copy_from_slice(&[-1, 2, -3, 4]),
            ColumnMut::I64(values) => values.copy_from_slice(&[i64::MIN, 0, 1, i64::MAX]),
            ColumnMut::F32(values) => {
                values
                    .iter_mut()
                    .enumerate()
                    .for_each(|(i, value)| *value = i as f32);
            }
            ColumnMut::Bool(values) => values.copy_from_slice(&[0, 1, 0, 1]),
            ColumnMut::Utf8(texts) => {
                write_texts(
                    texts.offsets,
                    texts.bytes,
                    ["a", "bc", "", "\u{b5}"].as_slice(),
                );
            }
            ColumnMut::Dictionary(codes, texts) => {
                codes.copy_from_slice(&[2, 0, 1, 2]);
                write_texts(texts.offsets, texts.bytes, &TEXTS);
            }
            _ => return Err(Failure::internal("a column of another type")),
        }
    }
    out.header_mut()
        .metadata
        .insert("origin".into(), json!({"camera": "simulated"}));
    out.finish()
}

fn write_texts(offsets: &mut [u64], bytes: &mut [u8], texts: &[&str]) {
    let mut end = 0;
    for (i, text) in texts.iter().enumerate() {
        bytes[end..end + text.len()].copy_from_slice(text.as_bytes());
        end += text.len();
        offsets[i + 1] = end as u64;
    }
}

fn image(job: &Job, forget: bool) -> Result<(), Failure> {
    let image = ImageInfo::plane(4, 3, 5.0, 100.0, 200.0);
    let mut out = job.begin("image", Header::image("image", image, Element::F32, "1"))?;
    out.f32_mut("value")?
        .iter_mut()
        .enumerate()
        .for_each(|(i, value)| *value = i as f32);
    if forget {
        return Ok(());
    }
    out.finish()
}

fn mesh(job: &Job) -> Result<(), Failure> {
    let corner = |name: &str| ColumnInfo::new(name, Element::F64, "nm").role("position");
    let vertices = vec![corner("x"), corner("y"), corner("z")];
    let mut out = job.begin("mesh", Header::mesh("mesh", vertices, 100, 200))?;
    for (column, values) in
        out.columns_mut(0)?
            .into_iter()
            .zip([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]])
    {
        if let ColumnMut::F64(out) = column {
            out[..3].copy_from_slice(&values);
        }
    }
    for (i, column) in out.columns_mut(1)?.into_iter().enumerate() {
        if let ColumnMut::U32(corners) = column {
            corners[0] = i as u32;
        }
    }
    out.finish_rows(&[3, 1])
}

/// Sums up a column that a series of a figure names.
#[derive(Params)]
struct SumSeries {
    /// Column.
    column: String,
}

impl Operation for SumSeries {
    const ID: &'static str = "test.sum-series/1";

    fn info() -> Info {
        let figure = Step {
            op: AllKinds::ID.into(),
            output: Some("figure".into()),
            ..Step::default()
        };
        Info::operation("Sum of a series")
            .input(Ports::figure("figure"))
            .output(Ports::report("report"))
            .example(json!({"column": "f32"}))
            .example_step("figure", figure)
    }

    fn prepare(&self, _: &Request) -> Result<Plan, Failure> {
        let columns = vec![self.column.clone()];
        let (input, part) = (0, 0);
        let read = vec![Read {
            input,
            part,
            columns,
        }];
        Ok(Plan {
            read,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let values = job.input("figure")?.f64(&self.column)?;
        let mut report = Report::new("report");
        report.number("sum", values.iter().sum(), "1");
        job.report(&report)
    }
}

puncta_sdk::register!(AllKinds);
puncta_sdk::register!(SumSeries);
