//! What earlier sessions left behind that ended inside a plugin, and the marks of this one.

use super::{Engine, Options};
use crate::plugins::catalogue::Installed;
use crate::plugins::crashes::{self, Crash, Crashes, PATIENCE};
use crate::plugins::sentinel::Sentinel;
use puncta_documents::Failure;
use std::sync::Arc;

impl Options {
    /// What is known of earlier sessions, and why no more.
    pub(super) fn crashes(&self) -> (Crashes, Option<Failure>) {
        match self.state.as_deref().map(crashes::look) {
            None => (Crashes::default(), None),
            Some(Ok(crashes)) => (crashes, None),
            // Records of crashes must not keep anybody from working.
            Some(Err(failure)) => (Crashes::default(), Some(failure)),
        }
    }
}

impl Engine {
    /// Sessions that ended inside an installed plugin, as long as the person did not decide about
    /// it and its library is the same.
    pub fn crashes(&self) -> impl Iterator<Item = &Crash> {
        self.crashes.plugins.iter().filter_map(|(hash, crash)| {
            let mut plugins = self.catalogue.plugins().iter();
            plugins.any(|one| &one.packed.hash == hash).then_some(crash)
        })
    }

    /// Why nothing is known of earlier sessions, if that is so.
    #[must_use]
    pub fn crash_trouble(&self) -> Option<&Failure> {
        self.crash_trouble.as_ref()
    }

    /// Whether sessions ended inside a plugin so often that it runs in a worker.
    #[must_use]
    pub fn demoted(&self, plugin: &Installed) -> bool {
        let crash = self.crashes.plugins.get(&plugin.packed.hash);
        crash.is_some_and(|crash| crash.count >= PATIENCE)
    }

    /// Remembers that the person was told of all of [`Engine::crashes`].
    ///
    /// # Errors
    /// When that cannot be written.
    pub fn told_of_crashes(&self) -> Result<(), Failure> {
        if self.crashes().all(|crash| crash.told) {
            return Ok(());
        }
        self.change_crashes(|now| {
            for (hash, known) in &self.crashes.plugins {
                if let Some(crash) = now.plugins.get_mut(hash) {
                    // Another session may have ended meanwhile.
                    crash.told |= crash.count == known.count;
                }
            }
        })
    }

    /// Forgets what happened with a plugin: the person decided about it.
    pub(super) fn forget_crashes(&self, id: &str) -> Result<(), Failure> {
        let any = self
            .crashes
            .plugins
            .values()
            .any(|crash| crash.plugin == id);
        if !any {
            return Ok(());
        }
        self.change_crashes(|now| now.plugins.retain(|_, crash| crash.plugin != id))
    }

    fn change_crashes(&self, change: impl FnOnce(&mut Crashes)) -> Result<(), Failure> {
        let Some(state) = &self.options.state else {
            return Ok(());
        };
        crashes::file(state).change(|now| {
            change(now);
            Ok(())
        })
    }

    /// Marks of the calls in this process; none where nothing can be kept.
    pub(super) fn sentinel(&self) -> Option<Arc<Sentinel>> {
        let make = || {
            let state = self.options.state.as_deref()?;
            let _turn = crashes::file(state).turn().ok()?;
            Sentinel::create(state).ok().map(Arc::new)
        };
        self.sentinel.get_or_init(make).clone()
    }
}
