//! `puncta run --watch`: the recipe runs again when something that it depends on changes.

use super::once;
use crate::cli::Run;
use crate::context::Context;
use crate::exit::{Ended, say, sentence};
use puncta_engine::Progress;
use puncta_engine::documents::Failure;
use puncta_engine::headless::{Sources, keeping};
use puncta_engine::{Engine, store::installed_memory};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// Between two looks at the files.
const LOOK: Duration = Duration::from_millis(200);
/// A file that is being written changes again soon: it is taken when it has been quiet so long.
const QUIET: Duration = Duration::from_millis(300);

pub(super) fn watch(context: &Context, run: &Run) -> Result<Ended, Failure> {
    let mut run = run.clone();
    let mut engine = Arc::clone(&context.engine);
    let memory = installed_memory().unwrap_or(8 << 30) / 4;
    let (mut session, mut sources) = (keeping(&engine, memory), Sources::kept());
    loop {
        let seen = Seen::now(&run, &engine);
        match once(context, &run, (&session, &mut sources)) {
            Ok(Ended::Stopped) => return Ok(Ended::Stopped),
            Ok(_) => {}
            Err(failure) if failure.is_cancelled() => return Ok(Ended::Stopped),
            Err(failure) => say(&sentence(&failure)),
        }
        context.watch.end();
        // From now on the files that are there are its own.
        run.overwrite = true;
        if !context.watch.quiet() {
            say("waiting for changes; Ctrl-C ends it");
        }
        let Some(now) = seen.wait(&run, &engine, &|| context.watch.cancelled()) else {
            return Ok(Ended::Stopped);
        };
        if now.plugins != seen.plugins {
            // Libraries are opened from copies by hash, so that the new one is another.
            engine = Arc::new(Engine::open(engine.options().clone())?);
            (session, sources) = (keeping(&engine, memory), Sources::kept());
        }
    }
}

/// Files with their sizes and times.
type Files = Vec<(PathBuf, Option<(u64, SystemTime)>)>;

/// What a run depends on, as it is at one time.
#[derive(Clone, PartialEq)]
struct Seen {
    files: Files,
    plugins: Files,
}

impl Seen {
    fn now(run: &Run, engine: &Engine) -> Seen {
        let inputs = run.input.iter().filter_map(|text| text.split_once('='));
        let inputs = inputs.map(|(_, file)| PathBuf::from(file));
        let files = std::iter::once(run.recipe.clone()).chain(inputs);
        let mut plugins: Files = Vec::new();
        for folder in &engine.options().folders {
            below(&folder.path, 2, &mut plugins);
        }
        Seen {
            files: files.map(look).collect(),
            plugins,
        }
    }

    /// Waits for a change, and until nothing changes any more; none if the person stopped it.
    fn wait(&self, run: &Run, engine: &Engine, cancelled: &dyn Fn() -> bool) -> Option<Seen> {
        let mut last = self.clone();
        let mut quiet = Duration::ZERO;
        loop {
            if cancelled() {
                return None;
            }
            std::thread::sleep(LOOK);
            let now = Seen::now(run, engine);
            quiet = if now == last {
                quiet + LOOK
            } else {
                Duration::ZERO
            };
            last = now;
            if last != *self && quiet >= QUIET {
                return Some(last);
            }
        }
    }
}

fn look(path: PathBuf) -> (PathBuf, Option<(u64, SystemTime)>) {
    let metadata = path.metadata().ok();
    let state = metadata.and_then(|one| Some((one.len(), one.modified().ok()?)));
    (path, state)
}

/// Files of a plugin folder and of the folders in it.
fn below(folder: &Path, depth: usize, into: &mut Files) {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        match path.is_dir() {
            true if depth > 0 => below(&path, depth - 1, into),
            true => {}
            false => into.push(look(path)),
        }
    }
}
