//! A recipe run on files without a window: inputs read, steps run, outputs written with their
//! provenance.

use crate::engine::{Engine, SourceFile, Steps, Written, lineage};
use crate::files::{check_below, check_target, folder_of};
use crate::job::Progress;
use crate::provenance::{InputRecord, Lineage};
use crate::recipe::{
    Checked, CheckedInput, CheckedOutput, Inputs, Limits, RunReport, Session, Wanted, Watch,
    output_path,
};
use crate::store::Object;
use puncta_documents::{Failure, FailureCode, Header, Kind, Map};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// Steps that run at once; each uses all threads where it can.
const PARALLEL: usize = 2;

/// A session for a recipe that is run once: nothing is kept for later.
#[must_use]
pub fn single(engine: &Arc<Engine>) -> Session<Steps> {
    keeping(engine, 0)
}

/// A session that keeps so many bytes of results.
#[must_use]
pub fn keeping(engine: &Arc<Engine>, memory: u64) -> Session<Steps> {
    let limits = Limits {
        parallel: PARALLEL,
        memory,
    };
    Session::new(Steps(Arc::clone(engine)), limits)
}

/// Inputs that were read and need not be read again while their files do not change.
#[derive(Debug, Default)]
pub struct Sources {
    keep: bool,
    known: Vec<(Ident, SourceFile)>,
}

/// What a source depends on, as far as can be told without reading the file.
#[derive(Clone, Debug, PartialEq)]
struct Ident {
    path: PathBuf,
    bytes: u64,
    modified: Option<SystemTime>,
    reader: Option<String>,
    options: Map,
    object: Option<String>,
    kind: Kind,
}

impl Sources {
    /// Sources that are kept.
    #[must_use]
    pub fn kept() -> Sources {
        Sources {
            keep: true,
            known: Vec::new(),
        }
    }

    fn get(
        &mut self,
        engine: &Engine,
        input: &CheckedInput,
        path: &Path,
        progress: &Arc<dyn Progress>,
    ) -> Result<SourceFile, Failure> {
        if !self.keep {
            return read(engine, input, path, progress);
        }
        let metadata = path.metadata();
        let ident = Ident {
            path: path.to_owned(),
            bytes: metadata.as_ref().map_or(0, std::fs::Metadata::len),
            modified: metadata.ok().and_then(|metadata| metadata.modified().ok()),
            reader: input.reader.as_ref().map(|reader| reader.id.clone()),
            options: input.options.clone(),
            object: input.object.clone(),
            kind: input.kind,
        };
        if let Some((_, source)) = self.known.iter().find(|(known, _)| *known == ident) {
            return Ok(source.clone());
        }
        let source = read(engine, input, path, progress)?;
        self.known.retain(|(known, _)| known.path != ident.path);
        self.known.push((ident, source.clone()));
        Ok(source)
    }
}

/// A file that was written.
#[derive(Clone, Debug)]
pub struct Saved {
    /// The file as it was asked for.
    pub path: PathBuf,
    /// What it holds.
    pub header: Header,
    /// Files, writer, options.
    pub written: Written,
    /// Where it says what it was made of.
    pub provenance: Option<PathBuf>,
}

/// What is written how.
#[derive(Clone, Copy, Debug)]
pub struct Saving<'a> {
    /// Where.
    pub path: &'a Path,
    /// Writer; by the suffix if none.
    pub writer: Option<&'a str>,
    /// Its options.
    pub options: &'a Map,
    /// Replace a file that exists.
    pub overwrite: bool,
}

impl Engine {
    /// Writes an object, and beside it what it was made of.
    ///
    /// # Errors
    /// As [`Engine::save`]; the sentence names the file.
    pub fn save_with(
        &self,
        saving: Saving<'_>,
        object: &Object,
        made: Lineage,
        progress: &Arc<dyn Progress>,
    ) -> Result<Saved, Failure> {
        let Saving {
            path,
            writer,
            options,
            overwrite,
        } = saving;
        let written = self
            .save(path, writer, options, object, overwrite, progress)
            .map_err(|failure| located(failure, path))?;
        let provenance = self.write_provenance(&written, made, &**progress)?;
        Ok(Saved {
            path: path.to_owned(),
            header: object.header().clone(),
            written,
            provenance: Some(provenance),
        })
    }
}

/// A checked recipe with its files.
#[derive(Debug)]
pub struct Task<'a> {
    /// The recipe.
    pub plan: &'a Checked,
    /// Files of the inputs, in the order of the recipe.
    pub files: Vec<(&'a CheckedInput, PathBuf)>,
    /// Folder below which everything is written.
    pub out: &'a Path,
    /// Replace files that exist.
    pub overwrite: bool,
}

/// What came of a task.
#[derive(Debug)]
pub struct Done {
    /// Steps and results.
    pub report: RunReport<Object>,
    /// Files of the recipe: written, or why not.
    pub written: Vec<(String, Result<Saved, Failure>)>,
    /// The files that were read.
    pub inputs: BTreeMap<String, Vec<InputRecord>>,
}

impl<'a> Task<'a> {
    /// The files to write, all of which can be written as far as can be told. `label` stands for
    /// `{input}`.
    ///
    /// # Errors
    /// When one exists and may not be replaced, leads out of the folder, would replace an input, or
    /// two are one.
    pub fn targets(&self, label: &str) -> Result<Vec<(&'a CheckedOutput, PathBuf)>, Failure> {
        let mut targets: Vec<(&CheckedOutput, PathBuf)> = Vec::new();
        for output in &self.plan.outputs {
            let path = self.out.join(output_path(&output.file, label)?);
            check_below(self.out, &path)?;
            if path.parent().is_some_and(Path::is_dir) {
                check_target(&path, self.overwrite)?;
            }
            if targets.iter().any(|(_, other)| *other == path) {
                let message = format!("two outputs of the recipe go to {}", path.display());
                return Err(Failure::bad_file(message).remedy("rename one of the two"));
            }
            if let Some((_, path)) = self.files.iter().find(|(_, file)| same(file, &path)) {
                let message = format!("the recipe would write over its input {}", path.display());
                return Err(Failure::bad_file(message).remedy("choose another folder with --out"));
            }
            targets.push((output, path));
        }
        Ok(targets)
    }

    /// Reads what `sources` does not have, runs what the session does not have, and writes. A step
    /// or file that fails leaves the rest standing.
    ///
    /// # Errors
    /// When an input cannot be read, or the output folder cannot be made.
    pub fn run(
        &self,
        (session, sources): (&Session<Steps>, &mut Sources),
        targets: &[(&CheckedOutput, PathBuf)],
        progress: &Arc<dyn Progress>,
        watch: &dyn Watch,
    ) -> Result<Done, Failure> {
        let engine = &session.runner().0;
        std::fs::create_dir_all(self.out).map_err(|error| Failure::io("make", self.out, &error))?;
        let mut objects: Inputs<Object> = BTreeMap::new();
        let mut inputs: BTreeMap<String, Vec<InputRecord>> = BTreeMap::new();
        for (input, path) in &self.files {
            watch.started(&format!("reading {}", name(path)));
            let source = sources.get(engine, input, path, progress)?;
            for note in &source.notes {
                watch.message(&name(path), 2, note);
            }
            let known = input.name.to_string();
            let all = objects.entry(known.clone()).or_default();
            all.push((source.key, source.object));
            inputs.entry(known).or_default().push(source.record);
        }
        let wanted = match self.plan.outputs.is_empty() {
            true => Wanted::Everything,
            false => Wanted::Outputs,
        };
        let report = session.run(self.plan, &objects, &wanted, session.ticket(), watch);
        drop(objects);
        let mut written = Vec::new();
        for (output, path) in targets {
            let found = report.results.get(&output.from);
            let Some(found) = found.filter(|_| !report.cancelled) else {
                continue;
            };
            watch.started(&format!("writing {}", name(path)));
            let record = |step: &str| report.step(step).and_then(|step| step.record.clone());
            let made = output
                .source
                .map(|source| lineage(self.plan, source, &inputs, &record));
            let one = self.write(engine, (output, path), &found.objects, made, progress);
            written.push((output.file.clone(), one));
        }
        Ok(Done {
            report,
            written,
            inputs,
        })
    }

    fn write(
        &self,
        engine: &Engine,
        (output, path): (&CheckedOutput, &Path),
        objects: &[Object],
        made: Option<Lineage>,
        progress: &Arc<dyn Progress>,
    ) -> Result<Saved, Failure> {
        let [object] = objects else {
            let message = format!("{} is {} objects", output.from, objects.len());
            return Err(
                Failure::bad_input(format!("cannot write {}: {message}", path.display()))
                    .remedy("write something that is one object"),
            );
        };
        let made = made.ok_or_else(|| Failure::internal("an output of nothing"))?;
        // Again, since the steps took their time.
        check_below(self.out, path)?;
        let folder = folder_of(path);
        std::fs::create_dir_all(folder).map_err(|error| Failure::io("make", folder, &error))?;
        let saving = Saving {
            path,
            writer: output.writer.as_ref().map(|writer| writer.id.as_str()),
            options: &output.parameters,
            overwrite: self.overwrite,
        };
        engine.save_with(saving, object, made, progress)
    }
}

fn read(
    engine: &Engine,
    input: &CheckedInput,
    path: &Path,
    progress: &Arc<dyn Progress>,
) -> Result<SourceFile, Failure> {
    let reader = input.reader.as_ref().map(|reader| reader.id.as_str());
    let wanted = (input.object.as_deref(), input.kind);
    let source = engine.source(path, reader, &input.options, wanted, progress);
    source.map_err(|failure| {
        let mut failure = located(failure, path);
        if failure.code == FailureCode::BadParameter {
            failure = failure.context(format!("input {}", input.name));
            failure.code = FailureCode::BadFile;
        }
        failure
    })
}

fn same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// A file's name without its folder.
#[must_use]
pub fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Names the file in a sentence that does not.
#[must_use]
pub fn located(failure: Failure, path: &Path) -> Failure {
    match failure.message.contains(&name(path)) || failure.is_cancelled() {
        true => failure,
        false => failure.context(path.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_names_the_file_once() {
        let path = Path::new("data/a.csv");
        let text = |message: &str| located(Failure::bad_file(message), path).to_string();
        assert_eq!(text("row 3 is short"), "data/a.csv: row 3 is short");
        assert_eq!(text("a.csv: row 3 is short"), "a.csv: row 3 is short");
    }

    #[test]
    fn outputs_are_below_the_folder_and_not_over_an_input() {
        let output = |file: &str| CheckedOutput {
            file: file.into(),
            from: "a".into(),
            source: None,
            writer: None,
            parameters: Map::default(),
            failure: None,
        };
        let input = CheckedInput {
            name: "locs".into(),
            kind: Kind::Table,
            many: false,
            reader: None,
            options: Map::default(),
            object: None,
            failure: None,
        };
        let plan = Checked {
            inputs: vec![input],
            outputs: vec![output("{input}.tif"), output("b/x.csv")],
            ..Checked::default()
        };
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cell.tif");
        std::fs::write(&file, "x").unwrap();
        let targets = |out: &Path, overwrite| {
            let files = vec![(&plan.inputs[0], file.clone())];
            let task = Task {
                plan: &plan,
                files,
                out,
                overwrite,
            };
            let targets = task.targets("cell")?;
            Ok(targets
                .into_iter()
                .map(|(_, path)| path)
                .collect::<Vec<_>>())
        };
        let good: Result<Vec<PathBuf>, Failure> = targets(Path::new("out"), false);
        let good = good.unwrap();
        assert_eq!(good, [Path::new("out/cell.tif"), Path::new("out/b/x.csv")]);
        let sentence = |overwrite| targets(folder.path(), overwrite).unwrap_err().to_string();
        assert!(sentence(false).contains("exists already"));
        assert!(sentence(true).contains("would write over its input"));
    }
}
