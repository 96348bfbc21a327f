//! Operations that misbehave.

use puncta_sdk::prelude::*;
use std::time::{Duration, Instant};

/// Ways to misbehave.
#[derive(Choice, Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// Panics.
    Panic,
    /// Panics in a task of the host's pool.
    PanicInTask,
    /// Ends the process by abort.
    Abort,
    /// Ends the process by exit.
    Exit,
    /// Loops without looking whether it should stop.
    Hang,
    /// Fails with a reason.
    Fail,
    /// Finishes an output with more rows than it began.
    TooManyRows,
    /// Gives a selection whose rows do not increase.
    Unordered,
}

/// Misbehaves.
#[derive(Params)]
struct Misbehave {
    /// How.
    #[param(default = Fault::Panic)]
    fault: Fault,
    /// Whether already when it is prepared.
    #[param(default = false)]
    early: bool,
}

impl Misbehave {
    fn go(&self, job: Option<&Job>) -> Result<(), Failure> {
        match (self.fault, job) {
            (Fault::PanicInTask, Some(job)) => {
                job.parallel(10, &|i| assert!(i != 7, "task {i} is wrong"));
                Ok(())
            }
            (Fault::TooManyRows, Some(job)) => {
                let columns = vec![ColumnInfo::new("x", Element::F64, "nm")];
                job.begin("table", Header::table("table", 2, columns))?
                    .finish_rows(&[3])
            }
            (Fault::Unordered, Some(job)) => {
                let mut out = job.select("table")?;
                if let [first, second, ..] = out.u32_mut("row")? {
                    (*first, *second) = (1, 1);
                }
                out.finish_rows(&[2])
            }
            (Fault::Abort, _) => std::process::abort(),
            (Fault::Exit, _) => std::process::exit(3),
            (Fault::Hang, _) => {
                let begin = Instant::now();
                while begin.elapsed() < Duration::from_secs(20) {
                    std::hint::spin_loop();
                }
                Ok(())
            }
            (Fault::Fail, _) => Err(Failure::bad_input("the data are wrong")
                .row(7)
                .remedy("mend them")),
            _ => panic!("this plugin is wrong"),
        }
    }
}

impl Operation for Misbehave {
    const ID: &'static str = "test.misbehave/1";

    fn info() -> Info {
        Info::operation("Misbehave")
            .input(Ports::table("table").optional())
            .output(Ports::selection("table", "table"))
    }

    fn prepare(&self, _request: &Request) -> Result<Plan, Failure> {
        if self.early {
            self.go(None)?;
        }
        Ok(Plan {
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.go(Some(job))
    }
}

/// Waits, and looks whether it should stop.
#[derive(Params)]
struct Wait {
    /// How long.
    #[param(default = 10.0, unit = "s", min = 0.0)]
    time: f64,
}

impl Operation for Wait {
    const ID: &'static str = "test.wait/1";

    fn info() -> Info {
        Info::operation("Wait").example(puncta_sdk::serde_json::json!({"time": 0}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let begin = Instant::now();
        while begin.elapsed().as_secs_f64() < self.time {
            job.progress(begin.elapsed().as_secs_f64() / self.time, "waiting")?;
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

/// Is quick, and says that nobody can stop it.
#[derive(Params)]
struct Stubborn;

impl Operation for Stubborn {
    const ID: &'static str = "test.stubborn/1";

    fn info() -> Info {
        Info::operation("Stubborn").example(puncta_sdk::serde_json::json!({}))
    }

    fn prepare(&self, _request: &Request) -> Result<Plan, Failure> {
        Ok(Plan {
            interruptible: false,
            ..Plan::default()
        })
    }

    fn run(&self, _job: &Job) -> Result<(), Failure> {
        Ok(())
    }
}

puncta_sdk::register!(Misbehave, Wait, Stubborn);
