//! Plugins that are there and are not used: the person did not consent, or switched them off.

use super::catalogue::Installed;
use super::library_file::Facts;
use super::packed::Packed;
use puncta_documents::{Failure, FailureCode, Operation, OperationKind};
use std::path::PathBuf;
use std::sync::Arc;

/// A plugin that is there and is not used.
#[derive(Clone, Debug)]
pub struct Held {
    /// The library.
    pub library: PathBuf,
    /// What the file is; absent when it is no library.
    pub facts: Option<Facts>,
    /// What `plugin.json` says, which is only a claim as long as nobody trusts the library.
    pub claimed: Option<Packed>,
    /// Why it is not used.
    pub why: Why,
}

/// Why a plugin is not used.
#[derive(Clone, Debug)]
pub enum Why {
    /// Nobody consented to this library.
    New,
    /// It is not the library that `plugin.json` was made from.
    Repacked,
    /// It is not the library that the person trusted, on this day.
    Changed(String),
    /// The person switched the plugin off.
    Disabled(Arc<Installed>),
    /// It cannot be used at all.
    Broken(Failure),
}

impl Held {
    /// Id of the plugin, as far as anything says it.
    #[must_use]
    pub fn id(&self) -> Option<&str> {
        self.claimed
            .as_ref()
            .map(|packed| packed.manifest.id.as_str())
    }

    /// Whether it waits for the person's consent.
    #[must_use]
    pub fn waits(&self) -> bool {
        matches!(self.why, Why::New | Why::Repacked | Why::Changed(_))
    }

    /// Why it is not used, in a sentence with what to do.
    #[must_use]
    pub fn failure(&self) -> Failure {
        let shown = self.library.display();
        let name = match self.id() {
            Some(id) => format!("the plugin {id} in {shown}"),
            None => format!("the library {shown}"),
        };
        let trust = format!("run puncta plugins trust {shown}");
        let refuse = |what: &str, remedy: String| {
            Failure::new(FailureCode::Unsupported, format!("{name} {what}")).remedy(remedy)
        };
        match &self.why {
            Why::New => refuse(
                "does not belong to this program and waits for your consent",
                format!("if you trust where it comes from, {trust}"),
            ),
            Why::Repacked => refuse(
                "has changed since it was packed, and waits for your consent",
                format!("if you trust the change, {trust}"),
            ),
            Why::Changed(day) => refuse(
                &format!("has changed since it was trusted on {day}, and waits for your consent"),
                format!("if you trust the change too, {trust}"),
            ),
            Why::Disabled(_) => {
                let id = self.id().unwrap_or_default();
                let message = format!("the plugin {id} is disabled");
                Failure::new(FailureCode::Unsupported, message)
                    .remedy(format!("run puncta plugins enable {id}"))
            }
            Why::Broken(failure) => failure.clone(),
        }
    }

    fn operations(&self) -> &[Operation] {
        let claimed = self.claimed.as_ref();
        claimed.map_or(&[][..], |packed| &packed.manifest.operations)
    }

    /// Whether it says that it has an operation of this id; the id may lack its revision.
    #[must_use]
    pub fn offers(&self, id: &str) -> bool {
        let mut operations = self.operations().iter();
        operations.any(|operation| operation.id == id || operation.stem() == id)
    }

    /// Whether it says that it reads or writes files of this name.
    #[must_use]
    pub fn handles(&self, file: &str, kind: OperationKind) -> bool {
        let file = file.to_lowercase();
        let operations = self.operations().iter();
        let rules = operations
            .filter(|one| one.kind == kind)
            .filter_map(|one| one.file.as_ref());
        rules
            .flat_map(|rule| &rule.suffixes)
            .any(|suffix| !suffix.is_empty() && file.ends_with(suffix.as_str()))
    }
}
