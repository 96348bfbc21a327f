//! Operations that pass a table on with a column added, and misbehave when they are told to.

use crate::faults::Fault;
use crate::orders::{Phase, told};
use puncta_sdk::prelude::*;
use puncta_sdk::{Params, run::chunks_mut, serde_json::json};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Rows of one task.
const PIECE: usize = 512;
/// A thread of the plugin does not wait longer for the end of its process.
const PATIENCE: Duration = Duration::from_secs(10);

/// A call that may misbehave.
pub trait Told: Sync {
    /// What it is to do now.
    fn now(&self, phase: Phase) -> Option<Fault>;
    /// Added to x.
    fn shift(&self) -> f64 {
        1.0
    }
    /// Seconds that the work takes at least.
    fn time(&self) -> f64 {
        0.0
    }

    /// Does what it is to do now.
    ///
    /// # Errors
    /// When a limit did not hold that should have.
    fn strike(&self, phase: Phase) -> Result<(), Failure> {
        self.now(phase).map_or(Ok(()), Fault::commit)
    }
}

fn info(title: &str) -> Info {
    let points = json!({"rows": 2000});
    Info::operation(title)
        .input(Ports::table("table").column("x", "nm"))
        .output(Ports::columns("table", "table"))
        .example(json!({}))
        .example_input("table", "test.points/1", points)
}

fn pass(job: &Job, told: &dyn Told) -> Result<(), Failure> {
    told.strike(Phase::Run)?;
    work(job, told.time())?;
    let table = job.input("table")?;
    let x = table.f64("x")?;
    let columns = [ColumnInfo::new("passed", Element::F64, "nm")];
    let mut out = job.add_columns("table", columns)?;
    let failed = Mutex::new(Ok(()));
    let struck = table.rows().div_ceil(PIECE).saturating_sub(1).min(2);
    chunks_mut(job, out.f64_mut("passed")?, PIECE, &|i, chunk| {
        if i == struck {
            let mut failed = failed.lock().unwrap_or_else(PoisonError::into_inner);
            *failed = told.strike(Phase::Task);
        }
        for (passed, x) in chunk.iter_mut().zip(&x[i * PIECE..]) {
            *passed = x + told.shift();
        }
    });
    failed
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner)?;
    if let Some(fault) = told.now(Phase::Callback) {
        while_inside_the_host(job, &out.committer(), fault)?;
    }
    let rows = table.rows() as u64;
    out.commit(0, rows)?;
    told.strike(Phase::Commit)?;
    match told.now(Phase::Run) {
        Some(Fault::TooManyRows) => return out.finish_rows(&[rows + 1]),
        Some(Fault::Unfinished) => return Ok(()),
        _ => out.finish()?,
    }
    told.strike(Phase::Finished)
}

fn work(job: &Job, seconds: f64) -> Result<(), Failure> {
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < seconds {
        job.progress(begin.elapsed().as_secs_f64() / seconds, "working")?;
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

/// Misbehaves in one thread while another does nothing but call the host.
fn while_inside_the_host(
    job: &Job,
    output: &puncta_sdk::Committer<'_>,
    fault: Fault,
) -> Result<(), Failure> {
    std::thread::scope(|scope| {
        let other = scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(2));
            fault.commit()
        });
        let begin = Instant::now();
        while !other.is_finished() && begin.elapsed() < PATIENCE {
            output.commit(0, 0)?;
            job.progress(0.5, "inside the host")?;
        }
        other
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Passes its table on, with the column `passed`, and follows orders from a file.
#[derive(Params)]
pub struct Pass {
    /// File with orders; each line is a phase, a fault and a step.
    #[param(default = "")]
    orders: String,
    /// Name in the orders.
    #[param(default = "pass")]
    step: String,
    /// Added to x.
    #[param(default = 1.0, unit = "nm")]
    shift: f64,
    /// Time that it takes at least.
    #[param(default = 0.0, unit = "s", min = 0.0, max = 10.0)]
    time: f64,
}

impl Told for Pass {
    fn now(&self, phase: Phase) -> Option<Fault> {
        let parameters = json!({"orders": self.orders, "step": self.step});
        told(None, &parameters, phase)
    }

    fn shift(&self) -> f64 {
        self.shift
    }

    fn time(&self) -> f64 {
        self.time
    }
}

macro_rules! misbehaving {
    ($type:ident, $id:literal, $title:literal) => {
        impl Operation for $type {
            const ID: &'static str = $id;

            fn info() -> Info {
                info($title)
            }

            fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
                self.strike(Phase::Prepare)?;
                Ok(puncta_sdk::operation::default_plan::<Self>(request))
            }

            fn run(&self, job: &Job) -> Result<(), Failure> {
                pass(job, self)
            }
        }

        impl Drop for $type {
            fn drop(&mut self) {
                // Nobody is there to be told.
                _ = self.strike(Phase::Drop);
            }
        }

        puncta_sdk::register!($type);
    };
}

misbehaving!(Pass, "fault.pass/1", "Pass");

/// One operation for each fault, of the same name.
macro_rules! one_each {
    ($($fault:ident $id:literal $title:literal;)+) => {$(
        #[doc = $title]
        #[derive(Params)]
        struct $fault {
            /// When it misbehaves.
            #[param(default = Phase::Never)]
            phase: Phase,
            /// File; it misbehaves only while this is there.
            only_while: Option<String>,
        }

        impl Told for $fault {
            fn now(&self, phase: Phase) -> Option<Fault> {
                let when = puncta_sdk::FromValue::to_value(&self.phase);
                let parameters = json!({"phase": when, "only_while": self.only_while});
                told(Some(Fault::$fault), &parameters, phase)
            }
        }

        misbehaving!($fault, $id, $title);
    )+};
}

one_each! {
    Panic "fault.panic/1" "Panics";
    Abort "fault.abort/1" "Aborts";
    Segfault "fault.segfault/1" "Writes where no memory is";
    Overflow "fault.overflow/1" "Overflows its stack";
    ExitZero "fault.exit-zero/1" "Exits with status 0";
    ExitThree "fault.exit-three/1" "Exits with status 3";
    Hang "fault.hang/1" "Loops for ever";
    Memory "fault.memory/1" "Takes all memory";
    Flood "fault.flood/1" "Floods its output streams";
    Child "fault.child/1" "Leaves a child process";
    Detached "fault.detached/1" "Leaves a detached child process";
    Descriptors "fault.descriptors/1" "Leaves no file descriptors";
    Close "fault.close/1" "Closes files that are not its own";
    Kill "fault.kill/1" "Kills itself";
    Bus "fault.bus/1" "Reads behind the end of a file";
    Illegal "fault.illegal/1" "Executes what is no instruction";
    Arithmetic "fault.arithmetic/1" "Divides by zero";
    Thread "fault.thread/1" "Leaves a thread";
    LateCrash "fault.late-crash/1" "Leaves a thread that crashes";
    BadDocument "fault.bad-document/1" "Gives a broken document";
    NullDocument "fault.null-document/1" "Gives a document that is not there";
    NotUtf8 "fault.not-utf8/1" "Gives a document that is no UTF-8";
    WildStatus "fault.wild-status/1" "Returns a status that does not exist";
    NoReason "fault.no-reason/1" "Fails without a reason";
    BadReason "fault.bad-reason/1" "Fails with an unreadable reason";
    Unwind "fault.unwind/1" "Lets a panic out";
    Misuse "fault.misuse/1" "Calls the host wrongly";
    Scribble "fault.scribble/1" "Writes into its input";
    TooManyRows "fault.too-many-rows/1" "Finishes too many rows";
    Unfinished "fault.unfinished/1" "Does not finish its output";
}
