//! A reader and a writer that misbehave as their file or their parameters say.

use crate::faults::Fault;
use crate::orders::{Phase, find, told};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::path::Path;

const MAGIC: &str = "puncta-fault";

/// Reads a file of orders, and follows those for the step `file`. Gives three points.
#[derive(Params)]
struct ReadFault;

fn orders(request: &Request) -> Result<String, Failure> {
    let file = request.file.as_ref();
    let file = file.ok_or_else(|| Failure::internal("the call has no file"))?;
    let path = Path::new(&file.path);
    let text = std::fs::read_to_string(path).map_err(|error| Failure::io("read", path, &error))?;
    if !text.starts_with(MAGIC) {
        let message = format!("{} is another kind of file", file.name);
        return Err(Failure::new(FailureCode::NotMine, message));
    }
    Ok(text)
}

fn strike(orders: &str, phase: Phase) -> Result<(), Failure> {
    find(orders, phase, "file").map_or(Ok(()), Fault::commit)
}

impl Operation for ReadFault {
    const ID: &'static str = "fault.read/1";

    fn info() -> Info {
        Info::reader("Read faults", &[".fault"])
            .formats(&[MAGIC.as_bytes()], &["orders"])
            .output(Ports::table("points"))
            .example_text("example.fault", MAGIC)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        strike(&orders(request)?, Phase::Prepare)?;
        Ok(Plan {
            interruptible: true,
            probe: Some(Probe {
                format: "orders".into(),
                confidence: 1.0,
            }),
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let orders = orders(job.request())?;
        strike(&orders, Phase::Run)?;
        let columns = vec![ColumnInfo::new("x", Element::F64, "nm").role("position")];
        let mut out = job.begin("points", Header::table("points", 3, columns))?;
        out.f64_mut("x")?.copy_from_slice(&[1.0, 2.0, 3.0]);
        out.commit(0, 3)?;
        strike(&orders, Phase::Commit)?;
        out.finish()
    }
}

/// Writes half of its file, misbehaves when it is told to, and writes the rest.
#[derive(Params)]
struct WriteFault {
    /// File with orders for the step `writer`.
    #[param(default = "")]
    orders: String,
}

impl WriteFault {
    fn strike(&self, phase: Phase) -> Result<(), Failure> {
        let parameters = json!({"orders": self.orders, "step": "writer"});
        told(None, &parameters, phase).map_or(Ok(()), Fault::commit)
    }
}

impl Operation for WriteFault {
    const ID: &'static str = "fault.write/1";

    fn info() -> Info {
        Info::writer("Write faults", &[".faulty"])
            .input(Ports::table("table").column("x", "nm"))
            .example(json!({}))
            .example_input("table", "test.points/1", json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let file = job.file()?;
        let path = Path::new(&file.path);
        let text: Vec<String> = job
            .input("table")?
            .f64("x")?
            .iter()
            .map(|x| format!("{x}\n"))
            .collect();
        let (first, rest) = text.split_at(text.len() / 2);
        let write = |text: String| {
            std::fs::write(path, text).map_err(|error| Failure::io("write", path, &error))
        };
        write(first.concat())?;
        self.strike(Phase::Run)?;
        write([first, rest].concat().concat())?;
        self.strike(Phase::Finished)
    }
}

puncta_sdk::register!(ReadFault, WriteFault);
