//! My plugin: reads points from text files that begin with `POINTS`, with x and y in each line.

use puncta_sdk::prelude::*;
use std::path::Path;

plugin! { id: "lab.my-plugin", title: "My plugin", description: "Reads points.", reentrant: true }

const MAGIC: &str = "POINTS";

/// Reads points from text.
#[derive(Params)]
pub struct ReadPoints {
    /// What the numbers of the file are multiplied with.
    #[param(default = 1.0, min = 1e-6, max = 1e6, unit = "1")]
    scale: f64,
}

impl Operation for ReadPoints {
    const ID: &'static str = "lab.my-plugin.read/1";

    fn info() -> Info {
        Info::reader("Points", &[".points"])
            .description("Reads points from text: the word POINTS, then x and y in each line.")
            .formats(&[MAGIC.as_bytes()], &["Points"])
            .output(Ports::table("localisations"))
            .example_text("small.points", "POINTS\n1.5 2\n3 4.25\n")
    }

    /// Looks at the beginning of the file only.
    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let path = request.file.as_ref().map_or("", |file| file.path.as_str());
        let mut head = Vec::new();
        std::fs::File::open(path)
            .and_then(|file| {
                use std::io::Read;
                file.take(MAGIC.len() as u64).read_to_end(&mut head)
            })
            .map_err(|error| Failure::io("read", Path::new(path), &error))?;
        if head != MAGIC.as_bytes() {
            let message = format!("the file does not begin with {MAGIC}");
            return Err(Failure::new(FailureCode::NotMine, message));
        }
        let probe = Probe {
            format: "Points".into(),
            confidence: 1.0,
        };
        Ok(Plan {
            probe: Some(probe),
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let path = Path::new(&job.file()?.path);
        let bytes = std::fs::read(path).map_err(|error| Failure::io("read", path, &error))?;
        let text = std::str::from_utf8(&bytes)
            .map_err(|_| Failure::bad_file("the file is not text in UTF-8"))?;
        let mut points = Vec::new();
        for (number, line) in text.lines().enumerate().skip(1) {
            if number % 65_536 == 0 {
                job.progress(0.5, "reading")?;
            }
            let mut words = line.split_whitespace().map(str::parse::<f64>);
            match (words.next(), words.next(), words.next()) {
                (Some(Ok(x)), Some(Ok(y)), None) => points.push([x, y]),
                (None, ..) => {}
                _ => {
                    let failure = Failure::bad_file("a line is not two numbers");
                    return Err(failure.row(number as u64 + 1).remedy("correct the line"));
                }
            }
        }
        let columns = ["x", "y"].map(|name| {
            let column = ColumnInfo::new(name, Element::F64, "nm");
            column.role("position")
        });
        let header = Header::table("localisations", points.len() as u64, columns.to_vec());
        let mut out = job.begin("localisations", header)?;
        for (axis, name) in ["x", "y"].into_iter().enumerate() {
            for (value, point) in out.f64_mut(name)?.iter_mut().zip(&points) {
                *value = self.scale * point[axis];
            }
        }
        out.finish()
    }
}

register!(ReadPoints);
