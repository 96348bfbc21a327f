//! The process of one check: it does it and writes down what it is doing and what it found.

use crate::check::{Check, Status};
use crate::item::Item;
use crate::material::Material;
use crate::plugin::{Ended, Instance};
use crate::raw;
use crate::setting::Setting;
use crate::{calls, data, documents, files, library, manifest, odd, process};
use puncta_engine::documents::{Failure, Kind, Manifest, Operation};
use puncta_engine::engine::Options;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What the process of a check is told.
#[derive(Clone, Debug)]
pub struct Orders {
    /// The check.
    pub check: Check,
    /// The library.
    pub library: PathBuf,
    /// Folder with the examples.
    pub folder: PathBuf,
    /// How much is asked.
    pub strictness: u8,
    /// File for what is being done and for the answer.
    pub answer: PathBuf,
    /// The engine's usual options.
    pub options: Options,
}

/// A line of the answer's file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Line {
    /// What is being done.
    Doing(String),
    /// What was found.
    Answer {
        /// How it ended.
        status: Status,
        /// What was found.
        sentence: String,
    },
}

/// What a check found when it did not fail.
pub enum Verdict {
    /// It holds.
    Passed,
    /// It holds, with a remark.
    Noted(String),
    /// It holds, but somebody should look at it.
    Warning(String),
    /// There was nothing to ask.
    Skipped(&'static str),
}

/// What a check found; an error is a failed check.
pub type Found = Result<Verdict, String>;

/// What a check stands on.
pub struct Ground {
    /// What it was told.
    pub orders: Orders,
    /// The examples.
    pub material: Material,
    begin: Instant,
}

/// An operation and the call of its example.
pub struct Case<'a> {
    /// The operation.
    pub operation: &'a Operation,
    /// The example as declared.
    pub full: Setting,
}

/// Rows of a small table.
const SMALL: u64 = 600;

impl Ground {
    /// Writes down what is being done, in case that it is the last thing.
    pub fn doing(&self, what: &str) {
        write_line(&self.orders.answer, &Line::Doing(what.into()));
    }

    /// Folder in which calls may write.
    pub fn scratch(&self) -> PathBuf {
        self.orders.answer.with_extension("scratch")
    }

    /// Opens the library and makes an instance.
    ///
    /// # Errors
    /// What is in the way.
    pub fn instance(&self) -> Result<Instance, String> {
        Instance::open(&self.orders.library, raw::Kind::Present)
    }

    /// Opens the library for its manifest.
    ///
    /// # Errors
    /// What is in the way.
    pub fn manifest(&self) -> Result<Manifest, String> {
        crate::plugin::Plugin::open(&self.orders.library)?.manifest()
    }

    /// Time that a check may take before it leaves the rest of the operations out.
    fn budget(&self) -> Duration {
        match self.orders.strictness {
            10.. => Duration::from_secs(3600),
            strictness => Duration::from_secs(u64::from(strictness).max(4)),
        }
    }

    /// Tries each operation of an instance; one without an example that could be made is left out.
    ///
    /// # Errors
    /// What `one` says of the first operation that fails, after the operation's id.
    pub fn each(
        &self,
        instance: &Instance,
        mut one: impl FnMut(&Case<'_>) -> Result<(), String>,
    ) -> Found {
        let (mut tried, mut left) = (0, 0);
        for operation in &instance.manifest.operations {
            if self.begin.elapsed() > self.budget() {
                left += 1;
                continue;
            }
            let Ok(full) = self.material.setting(operation, &self.scratch()) else {
                continue;
            };
            self.doing(&operation.id);
            one(&Case { operation, full }).map_err(|why| format!("{}: {why}", operation.id))?;
            tried += 1;
        }
        Ok(match (tried, left) {
            (0, _) => Verdict::Skipped("there is no operation to try"),
            (_, 0) => Verdict::Passed,
            (tried, left) => Verdict::Noted(format!(
                "{tried} operations were tried, {left} were left out for time; strictness 10 tries all"
            )),
        })
    }
}

impl Case<'_> {
    /// The example on at most a few hundred rows.
    pub fn small(&self) -> Setting {
        let cut = |item: &Item| odd::first(item, SMALL);
        self.full
            .with_tables(cut)
            .unwrap_or_else(|| self.full.clone())
    }

    /// A call that works: on a few hundred rows if that works, otherwise as declared.
    pub fn good(&self, instance: &Instance) -> Setting {
        let small = self.small();
        if instance.call(&small).ok() {
            small
        } else {
            self.full.clone()
        }
    }

    /// Whether any input is a table.
    pub fn has_table(&self) -> bool {
        self.full.headers().any(|header| header.kind == Kind::Table)
    }
}

/// Runs a call, and fails if it ends in a way that no input excuses.
///
/// # Errors
/// What no input excuses.
pub fn survives(instance: &Instance, setting: &Setting, what: &str) -> Result<Ended, String> {
    let ended = instance.call(setting);
    ended.decent().map_err(|why| format!("{what}: {why}"))?;
    Ok(ended)
}

fn write_line(path: &Path, line: &Line) {
    let file = std::fs::File::options()
        .create(true)
        .append(true)
        .open(path);
    if let (Ok(mut file), Ok(text)) = (file, serde_json::to_string(line)) {
        // Without its lines the process counts as crashed.
        let _ = writeln!(file, "{text}");
    }
}

/// Does one check.
///
/// # Errors
/// When its folder cannot be made.
pub fn child(orders: Orders) -> Result<(), Failure> {
    let ground = Ground {
        material: Material::load(&orders.folder),
        begin: Instant::now(),
        orders,
    };
    let scratch = ground.scratch();
    std::fs::create_dir_all(&scratch).map_err(|error| Failure::io("create", &scratch, &error))?;
    let (status, sentence) = match find(&ground) {
        Ok(Verdict::Passed) => (Status::Passed, String::new()),
        Ok(Verdict::Noted(text)) => (Status::Passed, text),
        Ok(Verdict::Warning(text)) => (Status::Warning, text),
        Ok(Verdict::Skipped(text)) => (Status::Skipped, text.into()),
        Err(text) => (Status::Failed, text),
    };
    write_line(&ground.orders.answer, &Line::Answer { status, sentence });
    Ok(())
}

fn find(ground: &Ground) -> Found {
    let check = ground.orders.check;
    let rooms = [
        library::find,
        manifest::find,
        documents::find,
        calls::find,
        data::find,
        process::find,
        files::find,
    ];
    rooms
        .iter()
        .find_map(|room| room(check, ground))
        .unwrap_or_else(|| Err("the validator does not know how".into()))
}
