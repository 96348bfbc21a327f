//! My plugin: writes points as text, x and y in each line after the word `POINTS`.

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

plugin! { id: "lab.my-plugin", title: "My plugin", description: "Writes points.", reentrant: true }

/// Writes points as text.
#[derive(Params)]
pub struct WritePoints {
    /// Digits behind the decimal point.
    #[param(default = 3, min = 0, max = 17)]
    digits: u64,
}

impl Operation for WritePoints {
    const ID: &'static str = "lab.my-plugin.write/1";

    fn info() -> Info {
        Info::writer("Points", &[".points"])
            .description("Writes points as text: the word POINTS, then x and y in each line.")
            .input(Ports::table("table").column("x", "nm").column("y", "nm"))
            .example(json!({"digits": 2}))
    }

    /// The host gives a path of its own, and moves the file when the call has succeeded.
    fn run(&self, job: &Job) -> Result<(), Failure> {
        let path = Path::new(&job.file()?.path);
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let digits = usize::try_from(self.digits).unwrap_or(17);
        let lost = |error: std::io::Error| Failure::io("write", path, &error);
        let mut file = BufWriter::new(File::create(path).map_err(lost)?);
        writeln!(file, "POINTS").map_err(lost)?;
        for (row, (x, y)) in x.iter().zip(y.iter()).enumerate() {
            if row % 65_536 == 0 {
                job.progress(row as f64 / table.rows() as f64, "writing")?;
            }
            writeln!(file, "{x:.digits$} {y:.digits$}").map_err(lost)?;
        }
        file.flush().map_err(lost)
    }
}

register!(WritePoints);
