//! What every command has at hand.

use crate::cli::Global;
use crate::output::Output;
use crate::watch::Watch;
use puncta_engine::documents::{Failure, Map};
use puncta_engine::headless::{Saved, Saving, located, name};
use puncta_engine::plugins::catalogue::Folder;
use puncta_engine::provenance::Lineage;
use puncta_engine::{Engine, Isolation, Object, Options, Progress, ReadFile};
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

    /// Writes an object, and beside it what it was made of.
    pub fn save(
        &self,
        saving: Saving<'_>,
        object: &Object,
        made: Lineage,
    ) -> Result<Saved, Failure> {
        self.watch.begin(&format!("writing {}", name(saving.path)));
        let progress = self.progress();
        let saved = self.engine.save_with(saving, object, made, &progress);
        self.watch.end();
        saved
    }
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
    fn a_name_is_split_off_only_if_it_is_one() {
        assert_eq!(
            bound("image=a=b.tif", &["image"]),
            (Some("image"), "a=b.tif".into())
        );
        assert_eq!(bound("a=b.tif", &["image"]), (None, "a=b.tif".into()));
    }
}
