//! Many files through one recipe: several at once, one bad file never stops the rest, and what was
//! done need not be done again.

pub(crate) mod collect;
mod page;
mod record;

pub use page::PAGE;
pub use record::{BATCH, BatchRecord, Entry, OutputEntry, RECORD, State};

use crate::engine::Engine;
use crate::files::write_whole;
use crate::headless::{Done, Sources, Task, single};
use crate::job::Progress;
use crate::provenance::FileRecord;
use crate::recipe::{Checked, CheckedInput, StepState, Watch};
use puncta_documents::Failure;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A batch.
#[derive(Debug)]
pub struct Batch<'a> {
    /// The recipe.
    pub plan: &'a Checked,
    /// BLAKE3 of all that the results depend on beside the files.
    pub recipe: String,
    /// The input that each file is bound to.
    pub each: &'a CheckedInput,
    /// Files of the other inputs.
    pub others: Vec<(&'a CheckedInput, PathBuf)>,
    /// The files.
    pub files: Vec<PathBuf>,
    /// Folder below which everything is written.
    pub out: &'a Path,
    /// Files that run at once; each waits for memory as its plans ask for it.
    pub jobs: usize,
    /// Leave out what an earlier run did.
    pub resume: bool,
    /// Replace files that exist.
    pub overwrite: bool,
    /// Tables to collect: the file to write, and the recipe's output file that is collected.
    pub collect: Vec<(String, String)>,
}

/// What a batch tells the person.
pub trait Observer: Watch + Sync {
    /// A file has ended, or was left out because it is done already.
    fn ended(&self, _entry: &Entry, _before: bool) {}
}

impl Observer for () {}

impl Batch<'_> {
    /// Runs it, and writes its record and its page into the output folder.
    ///
    /// # Errors
    /// When the folder cannot be written, or it holds another batch. What is wrong with a file is in
    /// its entry.
    pub fn run(
        &self,
        engine: &Arc<Engine>,
        progress: &Arc<dyn Progress>,
        observer: &dyn Observer,
    ) -> Result<BatchRecord, Failure> {
        std::fs::create_dir_all(self.out).map_err(|error| Failure::io("make", self.out, &error))?;
        let record = self.begin(observer)?;
        record.write(self.out)?;
        let board = Board {
            batch: self,
            record: Mutex::new(record),
            trouble: Mutex::new(None),
            next: AtomicUsize::new(0),
        };
        std::thread::scope(|scope| {
            for _ in 0..self.jobs.clamp(1, 64) {
                scope.spawn(|| board.work(engine, progress, observer));
            }
        });
        if let Some(failure) = lock(&board.trouble).take() {
            return Err(failure);
        }
        let mut record = board
            .record
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        if !progress.cancelled() {
            record.collected = collect::collect(self, &record, engine, progress)?;
        }
        record.write(self.out)?;
        write_whole(&self.out.join(PAGE), page::page(&record).as_bytes())?;
        Ok(record)
    }

    /// The record to begin with: of an earlier run, what still stands.
    fn begin(&self, observer: &dyn Observer) -> Result<BatchRecord, Failure> {
        let earlier = BatchRecord::read(self.out)?;
        if earlier.is_some() && !self.resume && !self.overwrite {
            let message = format!("{} holds a batch already", self.out.display());
            return Err(Failure::bad_file(message)
                .remedy("add --resume to go on with it, or --overwrite to do it again"));
        }
        let earlier = earlier.filter(|_| self.resume);
        if let Some(earlier) = &earlier
            && (earlier.recipe != self.recipe || *earlier.each != *self.each.name)
            && !self.overwrite
        {
            let message = format!("the batch in {} was of another recipe", self.out.display());
            return Err(Failure::bad_file(message)
                .remedy("choose another folder with --out, or add --overwrite to do it again"));
        }
        let same = earlier.filter(|earlier| earlier.recipe == self.recipe);
        let known: BTreeMap<&str, &Entry> = same
            .iter()
            .flat_map(|earlier| &earlier.files)
            .map(|entry| (entry.path.as_str(), entry))
            .collect();
        let mut record = BatchRecord {
            host: env!("CARGO_PKG_VERSION").into(),
            recipe: self.recipe.clone(),
            each: self.each.name.to_string(),
            ..BatchRecord::default()
        };
        for (path, label) in self.files.iter().zip(record::labels(&self.files)) {
            let absolute = std::path::absolute(path).unwrap_or_else(|_| path.clone());
            let path_text = absolute.display().to_string();
            let before = known.get(path_text.as_str()).filter(|entry| {
                entry.label == label && record.stands(entry, self.out) && unchanged(entry, path)
            });
            let entry = match before {
                Some(entry) => (*entry).clone(),
                None => Entry {
                    path: path_text,
                    label,
                    ..Entry::default()
                },
            };
            if before.is_some() {
                observer.ended(&entry, true);
            }
            record.files.push(entry);
        }
        Ok(record)
    }

    /// Whether the names of all outputs tell the files apart; otherwise each file has a folder.
    fn flat(&self) -> bool {
        let outputs = &self.plan.outputs;
        outputs.iter().all(|output| output.file.contains("{input}"))
    }

    fn file(
        &self,
        entry: &Entry,
        path: &Path,
        engine: &Arc<Engine>,
        progress: &Arc<dyn Progress>,
        watch: &dyn Watch,
    ) -> Result<Done, Failure> {
        let folder = match self.flat() {
            true => self.out.to_path_buf(),
            false => self
                .out
                .join(crate::recipe::output_path("{input}", &entry.label)?),
        };
        let mut files = self.others.clone();
        files.push((self.each, path.to_owned()));
        let place = |(input, _): &(&CheckedInput, PathBuf)| {
            let inputs = &self.plan.inputs;
            inputs.iter().position(|one| one.name == input.name)
        };
        files.sort_by_key(place);
        let task = Task {
            plan: self.plan,
            files,
            out: &folder,
            // What an ended run left of this file is not what the person has to be asked about.
            overwrite: self.overwrite || self.resume,
        };
        let targets = task.targets(&entry.label)?;
        let session = (&single(engine), &mut Sources::default());
        task.run(session, &targets, progress, watch)
    }
}

/// The file has the bytes that it had.
fn unchanged(entry: &Entry, path: &Path) -> bool {
    let Some(input) = &entry.input else {
        return false;
    };
    let same_size = path.metadata().is_ok_and(|now| now.len() == input.bytes);
    let now = || FileRecord::of(path, false, &crate::job::Unwatched);
    same_size && now().is_ok_and(|now| now.blake3 == input.blake3)
}

/// Where a batch stands while it runs.
struct Board<'a> {
    batch: &'a Batch<'a>,
    record: Mutex<BatchRecord>,
    /// Why the record could not be written.
    trouble: Mutex<Option<Failure>>,
    next: AtomicUsize,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Board<'_> {
    /// Takes one file after the other.
    fn work(&self, engine: &Arc<Engine>, progress: &Arc<dyn Progress>, observer: &dyn Observer) {
        loop {
            let at = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(path) = self.batch.files.get(at) else {
                return;
            };
            if progress.cancelled() || lock(&self.trouble).is_some() {
                return;
            }
            let Some(mut entry) = self.start(at) else {
                continue;
            };
            let begun = Instant::now();
            let done = self.batch.file(&entry, path, engine, progress, observer);
            entry.seconds = begun.elapsed().as_secs_f64();
            self.judge(&mut entry, done, progress.cancelled());
            observer.ended(&entry, false);
            self.change(|record| {
                if let Some(place) = record.files.get_mut(at) {
                    *place = entry;
                }
            });
        }
    }

    /// Marks a file as begun; none if it is done.
    fn start(&self, at: usize) -> Option<Entry> {
        let mut entry = lock(&self.record).files.get(at)?.clone();
        if entry.state == State::Done {
            return None;
        }
        entry.state = State::Running;
        self.change(|record| {
            if let Some(place) = record.files.get_mut(at) {
                *place = entry.clone();
            }
        });
        Some(entry)
    }

    fn change(&self, edit: impl FnOnce(&mut BatchRecord)) {
        let mut record = lock(&self.record);
        edit(&mut record);
        if let Err(failure) = record.write(self.batch.out) {
            lock(&self.trouble).get_or_insert(failure);
        }
    }

    /// What came of a file.
    fn judge(&self, entry: &mut Entry, done: Result<Done, Failure>, stopped: bool) {
        let done = match done {
            Ok(done) => done,
            Err(failure) => {
                entry.state = match failure.is_cancelled() {
                    true => State::Stopped,
                    false => State::Failed,
                };
                entry.errors.push(failure.to_string());
                return;
            }
        };
        let records = done.inputs.get(&*self.batch.each.name);
        let file = records.and_then(|records| records.first());
        entry.input = file.map(|record| record.file.clone());
        for step in &done.report.steps {
            if let StepState::Failed(failure) = &step.state {
                entry.errors.push(format!("step {}: {failure}", step.name));
            }
        }
        for (name, saved) in &done.written {
            match saved {
                Ok(saved) => entry.outputs.push(self.output(name, &saved.path)),
                Err(failure) => entry.errors.push(failure.to_string()),
            }
        }
        let whole = done.written.len() == self.batch.plan.outputs.len();
        entry.state = match (stopped || done.report.cancelled, entry.outputs.is_empty()) {
            _ if whole && entry.errors.is_empty() => State::Done,
            (true, _) => State::Stopped,
            (false, false) => State::Partly,
            (false, true) => State::Failed,
        };
    }

    fn output(&self, name: &str, path: &Path) -> OutputEntry {
        let below = path.strip_prefix(self.batch.out).unwrap_or(path);
        OutputEntry {
            name: name.to_owned(),
            path: below.display().to_string(),
            bytes: path.metadata().map_or(0, |metadata| metadata.len()),
        }
    }
}
