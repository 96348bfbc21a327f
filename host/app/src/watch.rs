//! Progress and notes for the person at the terminal, and Ctrl-C.

use crate::exit::say;
use crate::output::plain;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use puncta_engine::Progress;
use std::collections::HashSet;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Work that is done sooner gets no bar.
const PATIENCE: Duration = Duration::from_millis(300);
/// Notes that are shown; a plugin may have more to say than anybody reads.
const MOST_NOTES: usize = 100;
const STEPS: u64 = 1000;

/// Shows progress on a terminal and notes as lines, and says whether the person wants to stop.
pub struct Watch {
    stop: Arc<AtomicBool>,
    quiet: bool,
    terminal: bool,
    state: Mutex<State>,
}

struct State {
    began: Instant,
    what: String,
    bar: Option<ProgressBar>,
    notes: HashSet<String>,
}

impl Watch {
    /// Shows progress unless `quiet`, and stops when `stop` is set.
    pub fn new(stop: Arc<AtomicBool>, quiet: bool) -> Watch {
        let state = State {
            began: Instant::now(),
            what: String::new(),
            bar: None,
            notes: HashSet::new(),
        };
        let terminal = !quiet && std::io::stderr().is_terminal();
        Watch {
            stop,
            quiet,
            terminal,
            state: Mutex::new(state),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A new piece of work begins.
    pub fn begin(&self, what: &str) {
        let mut state = self.state();
        state.began = Instant::now();
        state.what = plain(what);
        if let Some(bar) = state.bar.take() {
            bar.finish_and_clear();
        }
    }

    /// The work is over.
    pub fn end(&self) {
        self.begin("");
    }

    /// Whether nobody wants to read notes.
    pub fn quiet(&self) -> bool {
        self.quiet
    }

    /// A line for the person, once.
    pub fn note(&self, text: &str) {
        if self.quiet {
            return;
        }
        let mut state = self.state();
        let shown = state.notes.len();
        if shown > MOST_NOTES || !state.notes.insert(text.to_owned()) {
            return;
        }
        let text = match shown {
            MOST_NOTES => "there are more notes".to_owned(),
            _ => plain(text),
        };
        match &state.bar {
            Some(bar) => bar.suspend(|| say(&text)),
            None => say(&text),
        }
    }
}

impl Progress for Watch {
    fn progress(&self, fraction: f64, phase: &str) {
        if !self.terminal {
            return;
        }
        let mut state = self.state();
        if state.bar.is_none() {
            if state.began.elapsed() < PATIENCE {
                return;
            }
            state.bar = Some(bar());
        }
        if let Some(bar) = &state.bar {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            bar.set_position((fraction.clamp(0.0, 1.0) * STEPS as f64) as u64);
            let phase = plain(phase);
            let gap = if state.what.is_empty() || phase.is_empty() {
                ""
            } else {
                ": "
            };
            bar.set_message(format!("{}{gap}{phase}", state.what));
        }
    }

    fn message(&self, level: u32, text: &str) {
        if level <= 2 {
            self.note(text);
        }
    }

    fn cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.end();
    }
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{bar:24} {percent:>3} %  {elapsed}  {wide_msg}");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

/// The first Ctrl-C (or termination signal) sets the flag that it returns, the second ends the
/// program at once.
pub fn signals() -> Arc<AtomicBool> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let stop = Arc::new(AtomicBool::new(false));
    for (signal, code) in [(SIGINT, 130), (SIGTERM, 143)] {
        // Without a handler the system ends the program, as it does by itself.
        let _ = signal_hook::flag::register_conditional_shutdown(signal, code, Arc::clone(&stop));
        let _ = signal_hook::flag::register(signal, Arc::clone(&stop));
    }
    stop
}

/// A terminal's Ctrl-C reaches workers too; it is the host that stops them.
pub fn leave_interrupts_to_the_host() {
    let nothing = Arc::new(AtomicBool::new(false));
    let _ = signal_hook::flag::register(signal_hook::consts::SIGINT, nothing);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flag_stops_the_work() {
        let stop = Arc::new(AtomicBool::new(false));
        let watch = Watch::new(Arc::clone(&stop), true);
        assert!(!watch.cancelled());
        watch.begin("reading");
        watch.progress(0.5, "rows");
        watch.note("not shown");
        stop.store(true, Ordering::Relaxed);
        assert!(watch.cancelled());
    }
}
