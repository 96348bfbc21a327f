//! What every command has at hand.

use crate::cli::Global;
use crate::output::Output;
use crate::watch::Watch;
use puncta_engine::documents::{Failure, Map};
use puncta_engine::plugins::catalogue::Folder;
use puncta_engine::{Engine, Isolation, Options, Progress, ReadFile};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Engine, output, progress.
pub struct Context {
    pub engine: Arc<Engine>,
    pub output: Output,
    pub watch: Arc<Watch>,
    pub json: bool,
}

/// The engine's options for these global options.
pub fn options(global: &Global) -> Result<Options, Failure> {
    let program = std::env::current_exe()
        .map_err(|error| Failure::io("find", Path::new("the program itself"), &error))?;
    let mut options = Options::usual(program);
    let own = global.plugins.iter().map(|path| Folder {
        path: path.clone(),
        bundled: false,
    });
    options.folders.splice(0..0, own);
    options.threads = global.threads.map_or(0, usize::from);
    options.isolation = match (global.isolated, global.in_process) {
        (true, _) => Isolation::Always,
        (_, true) => Isolation::OnlyInProcess,
        _ => Isolation::ByPlugin,
    };
    Ok(options)
}

impl Context {
    /// Progress as the engine takes it.
    pub fn progress(&self) -> Arc<dyn Progress> {
        Arc::clone(&self.watch) as Arc<dyn Progress>
    }

    /// Reads a file.
    pub fn read(
        &self,
        path: &Path,
        reader: Option<&str>,
        options: &Map,
    ) -> Result<ReadFile, Failure> {
        self.watch.begin(&format!("reading {}", name(path)));
        let read = self.engine.read(path, reader, options, &self.progress());
        self.watch.end();
        read.map_err(|failure| located(failure, path))
    }
}

/// Names the file in a sentence that does not.
pub fn located(failure: Failure, path: &Path) -> Failure {
    match failure.message.contains(&name(path)) || failure.is_cancelled() {
        true => failure,
        false => failure.context(path.display()),
    }
}

/// A file's name without its folder.
pub fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Refuses to write over a file, or into a folder that is not there, before anything is computed.
pub fn check_target(path: &Path, overwrite: bool) -> Result<(), Failure> {
    use puncta_engine::documents::FailureCode;
    let refuse = |what: &str, remedy: &str| {
        let message = format!("cannot write {}: {what}", path.display());
        Err(Failure::new(FailureCode::Io, message).remedy(remedy))
    };
    let folder = puncta_engine::files::folder_of(path);
    if path.is_dir() {
        return refuse("it is a folder", "name a file in it");
    }
    if !folder.is_dir() {
        return refuse("its folder is not there", "make the folder first");
    }
    if !overwrite && path.exists() {
        return refuse(
            "it exists already",
            "choose another name, or add --overwrite",
        );
    }
    Ok(())
}

/// Splits `NAME=FILE` where NAME is one of `names`.
pub fn bound<'a>(text: &'a str, names: &[&str]) -> (Option<&'a str>, PathBuf) {
    match text.split_once('=') {
        Some((name, file)) if names.contains(&name) => (Some(name), file.into()),
        _ => (None, text.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_checked_first() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        assert!(check_target(&file, false).is_ok());
        std::fs::write(&file, "x").unwrap();
        let sentence = |path: &Path| check_target(path, false).unwrap_err().to_string();
        assert!(
            sentence(&file).contains("exists already; choose another name, or add --overwrite")
        );
        assert!(check_target(&file, true).is_ok());
        assert!(sentence(folder.path()).contains("is a folder"));
        assert!(sentence(&folder.path().join("no/a.csv")).contains("folder is not there"));
    }

    #[test]
    fn a_sentence_names_the_file_once() {
        let path = Path::new("data/a.csv");
        let text = |message: &str| located(Failure::bad_file(message), path).to_string();
        assert_eq!(text("row 3 is short"), "data/a.csv: row 3 is short");
        assert_eq!(text("a.csv: row 3 is short"), "a.csv: row 3 is short");
        assert_eq!(
            bound("image=a=b.tif", &["image"]),
            (Some("image"), "a=b.tif".into())
        );
        assert_eq!(bound("a=b.tif", &["image"]), (None, "a=b.tif".into()));
    }
}
