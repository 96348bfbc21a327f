//! All checks of a library: which run, two at a time, and how each of their processes ended.

use crate::check::{Check, Outcome, Status};
use crate::child::Line;
use crate::material::{self, Material};
use puncta_engine::documents::Failure;
use puncta_engine::engine::Options;
use puncta_engine::{Engine, Progress};
use rustix::process::{Pid, Signal, kill_process_group};
use serde::Serialize;
use std::collections::BTreeMap;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Processes at a time.
const AT_ONCE: usize = 2;
const GLANCE: Duration = Duration::from_millis(5);

/// What is to be checked.
pub struct Order {
    /// The library.
    pub library: PathBuf,
    /// How much is asked: 1 to 10.
    pub strictness: u8,
    /// Checks to run, with what they need; empty means all of the strictness.
    pub only: Vec<Check>,
    /// The engine's usual options; their program is started for each check.
    pub options: Options,
}

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The library.
    pub library: PathBuf,
    /// How much was asked.
    pub strictness: u8,
    /// Outcomes in the order of the checks.
    pub checks: Vec<Outcome>,
    /// Time in all.
    pub seconds: f64,
}

impl Report {
    /// Whether nothing failed and nothing crashed.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.count(Status::Failed) + self.count(Status::Crashed) == 0
    }

    /// How many checks ended so.
    #[must_use]
    pub fn count(&self, status: Status) -> usize {
        let ended = self.checks.iter();
        ended.filter(|outcome| outcome.status == status).count()
    }
}

fn chosen(order: &Order) -> Vec<Check> {
    let mut wanted: Vec<Check> = if order.only.is_empty() {
        let all = Check::ALL.iter().copied();
        all.filter(|check| check.level() <= order.strictness)
            .collect()
    } else {
        order.only.clone()
    };
    // What a check needs stands before it, so that one pass from the end finds everything.
    for check in Check::ALL.iter().rev() {
        if wanted.contains(check) {
            wanted.extend(check.needs());
        }
    }
    let all = Check::ALL.iter().copied();
    all.filter(|check| wanted.contains(check)).collect()
}

/// Checks a library.
///
/// # Errors
/// When the library cannot be read, there is no place for temporary files, or the person cancels.
pub fn check(order: &Order, watch: &dyn Progress) -> Result<Report, Failure> {
    let begin = Instant::now();
    let place = std::env::temp_dir();
    let folder = tempfile::Builder::new().prefix("puncta-check-").tempdir();
    let folder = folder.map_err(|error| Failure::io("create a folder in", &place, &error))?;
    let own = folder.path().join("plugin");
    std::fs::create_dir(&own).map_err(|error| Failure::io("create", &own, &error))?;
    let library = own.join(order.library.file_name().unwrap_or_default());
    std::fs::copy(&order.library, &library)
        .map_err(|error| Failure::io("read", &order.library, &error))?;
    let bench = Bench {
        order,
        library,
        folder: folder.path(),
        outcomes: Mutex::default(),
        changed: Condvar::new(),
        watch,
        count: chosen(order).len(),
    };
    let (first, rest): (Vec<Check>, Vec<Check>) = chosen(order)
        .into_iter()
        .partition(|check| *check <= Check::Create);
    bench.all(&first);
    let ready = bench.status(Check::Create) == Some(Status::Passed);
    if ready && rest.iter().any(|check| !check.needs().is_empty()) {
        bench.prepare()?;
    }
    bench.all(&rest);
    if watch.cancelled() {
        return Err(Failure::cancelled());
    }
    let outcomes = bench
        .outcomes
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    Ok(Report {
        library: order.library.clone(),
        strictness: order.strictness,
        checks: outcomes.into_values().flatten().collect(),
        seconds: begin.elapsed().as_secs_f64(),
    })
}

struct Bench<'a> {
    order: &'a Order,
    library: PathBuf,
    folder: &'a Path,
    /// `None` while it runs.
    outcomes: Mutex<BTreeMap<Check, Option<Outcome>>>,
    changed: Condvar,
    watch: &'a dyn Progress,
    /// Checks in all.
    count: usize,
}

enum Next {
    Run(Check),
    Settle(Check, Outcome),
    Wait,
    Done,
}

impl Bench<'_> {
    fn status(&self, check: Check) -> Option<Status> {
        let outcomes = self.outcomes.lock().unwrap_or_else(PoisonError::into_inner);
        outcomes.get(&check)?.as_ref().map(|outcome| outcome.status)
    }

    /// Makes the examples.
    fn prepare(&self) -> Result<(), Failure> {
        let options = material::options(&self.order.options, self.folder, &self.library)?;
        let engine = Engine::open(options)?;
        let installed = engine.catalogue().plugins().iter();
        let mut installed = installed.filter(|plugin| plugin.library == self.library);
        let manifest = installed.next().map(|plugin| &plugin.packed.manifest);
        match manifest {
            Some(manifest) => Material::make(&engine, manifest, self.folder).map(|_| ()),
            None => Ok(()),
        }
    }

    fn all(&self, checks: &[Check]) {
        std::thread::scope(|scope| {
            for _ in 0..AT_ONCE {
                scope.spawn(|| self.work(checks));
            }
        });
    }

    fn work(&self, checks: &[Check]) {
        let mut outcomes = self.outcomes.lock().unwrap_or_else(PoisonError::into_inner);
        while !self.watch.cancelled() {
            match next(checks, &outcomes) {
                Next::Done => return,
                Next::Wait => {
                    let woken = self.changed.wait(outcomes);
                    outcomes = woken.unwrap_or_else(PoisonError::into_inner);
                }
                Next::Settle(check, outcome) => {
                    outcomes.insert(check, Some(outcome));
                    self.changed.notify_all();
                }
                Next::Run(check) => {
                    outcomes.insert(check, None);
                    let done = outcomes.len() as f64 / self.count as f64;
                    drop(outcomes);
                    self.watch.progress(done, check.id());
                    let outcome = self.one(check);
                    outcomes = self.outcomes.lock().unwrap_or_else(PoisonError::into_inner);
                    outcomes.insert(check, Some(outcome));
                    self.changed.notify_all();
                }
            }
        }
    }

    /// Runs one check in its own process.
    fn one(&self, check: Check) -> Outcome {
        let begin = Instant::now();
        let answer = self.folder.join(format!("{}.answer", check.id()));
        let said = self.folder.join(format!("{}.said", check.id()));
        let (status, sentence) = match self.process(check, &answer, &said) {
            Ok(ended) => judge(ended, &answer, &said, check),
            Err(error) => (
                Status::Crashed,
                format!("its process could not be started: {error}"),
            ),
        };
        Outcome {
            check: check.id().into(),
            status,
            sentence,
            seconds: begin.elapsed().as_secs_f64(),
        }
    }

    /// How the process ended; `None` if it had to be ended.
    fn process(
        &self,
        check: Check,
        answer: &Path,
        said: &Path,
    ) -> std::io::Result<Option<ExitStatus>> {
        let says = std::fs::File::create(said)?;
        let mut child = Command::new(&self.order.options.program)
            .arg("check-one")
            .arg(check.id())
            .arg(&self.library)
            .arg(self.folder)
            .arg(self.order.strictness.to_string())
            .arg(answer)
            .stdin(Stdio::null())
            .stdout(says.try_clone()?)
            .stderr(says)
            .process_group(0)
            .spawn()?;
        let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let begin = Instant::now();
        let limit = Duration::from_secs(check.seconds());
        let ended = loop {
            if let Some(status) = child.try_wait()? {
                break Some(status);
            }
            if begin.elapsed() > limit || self.watch.cancelled() {
                break None;
            }
            std::thread::sleep(GLANCE);
        };
        // What the plugin started ends as well.
        if let Some(group) = group {
            let _ = kill_process_group(group, Signal::KILL);
        }
        if ended.is_none() {
            let _ = child.kill();
            child.wait()?;
        }
        Ok(ended)
    }
}

fn next(checks: &[Check], outcomes: &BTreeMap<Check, Option<Outcome>>) -> Next {
    let mut waiting = false;
    for check in checks.iter().filter(|check| !outcomes.contains_key(check)) {
        let mut ready = true;
        for need in check.needs() {
            match outcomes.get(need) {
                Some(Some(outcome))
                    if matches!(outcome.status, Status::Passed | Status::Warning) => {}
                // The door is for plugins in Rust; what had nothing to ask keeps nobody.
                Some(Some(outcome)) if outcome.status == Status::Skipped && !held(outcome) => {}
                Some(Some(_)) => {
                    let sentence = format!("{HELD}{} did not pass", need.id());
                    return Next::Settle(
                        *check,
                        Outcome {
                            check: check.id().into(),
                            status: Status::Skipped,
                            sentence,
                            seconds: 0.0,
                        },
                    );
                }
                _ => ready = false,
            }
        }
        if ready {
            return Next::Run(*check);
        }
        waiting = true;
    }
    if waiting { Next::Wait } else { Next::Done }
}

const HELD: &str = "not asked, since ";

/// Whether a check was skipped since another failed.
fn held(outcome: &Outcome) -> bool {
    outcome.sentence.starts_with(HELD)
}

fn judge(ended: Option<ExitStatus>, answer: &Path, said: &Path, check: Check) -> (Status, String) {
    let lines = std::fs::read_to_string(answer).unwrap_or_default();
    let mut doing = String::new();
    for line in lines.lines() {
        match serde_json::from_str(line) {
            Ok(Line::Answer { status, sentence }) => return (status, sentence),
            Ok(Line::Doing(what)) => doing = what,
            Err(_) => {}
        }
    }
    let how = match ended {
        None => format!("it did not come back within {} s", check.seconds()),
        Some(status) => match status.signal() {
            Some(signal) => format!("its process was ended by {}", signal_name(signal)),
            None => format!("it ended its process with {status}"),
        },
    };
    let at = if doing.is_empty() {
        String::new()
    } else {
        format!("{doing}: ")
    };
    let words = String::from_utf8_lossy(&std::fs::read(said).unwrap_or_default()).into_owned();
    let last = words.lines().rev().find(|line| !line.trim().is_empty());
    let quoted = last.map(|line| {
        let line = line.trim();
        format!(", saying \"{}\"", &line[..line.floor_char_boundary(200)])
    });
    (
        Status::Crashed,
        format!("{at}{how}{}", quoted.unwrap_or_default()),
    )
}

fn signal_name(signal: i32) -> String {
    let known = [
        (4, "an illegal instruction"),
        (6, "an abort"),
        (7, "a bus error"),
        (8, "an arithmetic error"),
        (9, "a kill"),
        (11, "a segmentation fault"),
        (13, "a broken pipe"),
    ];
    let name = known.iter().find(|(number, _)| *number == signal);
    name.map_or_else(|| format!("signal {signal}"), |(_, name)| (*name).into())
}
