//! Reading files: which reader, and what it gives.

use super::call::{Called, Invocation};
use super::choose::{Able, YES, choose, is};
use super::{Engine, PreparedCall};
use crate::job::Progress;
use crate::store::Object;
use puncta_documents::{Failure, FailureCode, FileRef, Map, Operation, OperationKind};
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

/// What a file held.
#[derive(Clone, Debug, Default)]
pub struct ReadFile {
    /// Named objects.
    pub objects: Vec<(String, Object)>,
    /// Reader that was used.
    pub reader: String,
    /// Format that it recognised.
    pub format: String,
    /// Its options after defaults.
    pub options: Map,
    /// Sentences that the person should see.
    pub notes: Vec<String>,
}

impl Engine {
    /// Reads a file with the reader that knows it, or with the one that is named.
    ///
    /// # Errors
    /// When there is no such file, no reader knows it, several do, or the one that does fails.
    pub fn read(
        &self,
        path: &Path,
        reader: Option<&str>,
        options: &Map,
        progress: &Arc<dyn Progress>,
    ) -> Result<ReadFile, Failure> {
        let mut prepared = self.prepare_read(path, reader, options, progress)?;
        let plan = Arc::clone(prepared.plan());
        let outputs = prepared.run(progress)?;
        let format = plan
            .probe
            .as_ref()
            .map(|probe| probe.format.clone())
            .unwrap_or_default();
        Ok(ReadFile {
            objects: outputs,
            reader: prepared.operation_id().to_owned(),
            format,
            options: prepared.parameters().clone(),
            notes: plan.notes.clone(),
        })
    }

    /// Chooses the reader of a file and plans reading it.
    ///
    /// # Errors
    /// When there is no such file, no reader knows it, or several do.
    pub fn prepare_read(
        &self,
        path: &Path,
        reader: Option<&str>,
        options: &Map,
        progress: &Arc<dyn Progress>,
    ) -> Result<PreparedCall, Failure> {
        let (file, head) = look(path)?;
        let invoke = |operation: &Operation| Invocation {
            operation: operation.id.clone(),
            parameters: options.clone(),
            inputs: Vec::new(),
            file: Some(file.clone()),
        };
        if let Some(id) = reader {
            let (_, operation) = self.operation(id)?;
            if operation.kind != OperationKind::Reader {
                let message = format!("{} is no reader", operation.id);
                return Err(Failure::new(FailureCode::BadParameter, message));
            }
            return self.prepare(&invoke(operation), progress);
        }
        let candidates = self.candidates(path, &file.name, &head)?;
        let mut able: Vec<Able<PreparedCall>> = Vec::new();
        let mut refused: Option<Failure> = None;
        for (generic, operation) in candidates {
            let sure = able.iter().any(|one| one.confidence >= YES);
            if generic && sure && !self.is_chosen(&operation.id) {
                continue;
            }
            match self.prepare(&invoke(operation), progress) {
                Ok(call) => able.push(able_to(operation, call)),
                Err(failure) if failure.code == FailureCode::NotMine => {
                    refused.get_or_insert(failure);
                }
                // A reader that knows the file and finds it damaged is heard first.
                Err(failure) => {
                    let weak = refused
                        .as_ref()
                        .is_none_or(|f| f.code == FailureCode::NotMine);
                    if weak {
                        refused = Some(failure);
                    }
                }
            }
        }
        // A plugin that the person keeps from working may be the one that knows it.
        let foreign = |failure: &Failure| failure.code == FailureCode::NotMine;
        if able.is_empty()
            && refused.as_ref().is_none_or(foreign)
            && let Some(failure) = self
                .catalogue()
                .withheld_file(&file.name, OperationKind::Reader)
        {
            return Err(failure.context(format!("cannot read {}", path.display())));
        }
        choose(path, able, &self.settings, refused)
    }

    /// Whether the person chose this reader for some format.
    fn is_chosen(&self, id: &str) -> bool {
        self.settings.readers.values().any(|chosen| is(id, chosen))
    }

    /// Readers that a file may be for: those that know its suffix or its first bytes, then generic ones.
    fn candidates(
        &self,
        path: &Path,
        name: &str,
        head: &[u8],
    ) -> Result<Vec<(bool, &Operation)>, Failure> {
        let name = name.to_lowercase();
        let readers = || {
            self.catalogue()
                .operations()
                .map(|(_, operation)| operation)
                .filter(|operation| operation.kind == OperationKind::Reader)
        };
        let mut fitting: Vec<(bool, &Operation)> = readers()
            .filter_map(|operation| {
                let rule = operation.file.as_ref()?;
                let suffix = rule
                    .suffixes
                    .iter()
                    .any(|suffix| name.ends_with(suffix.as_str()));
                let magic = rule.magic.iter().any(|magic| starts_with(head, magic));
                (suffix || magic || rule.generic).then_some((rule.generic, operation))
            })
            .collect();
        fitting.sort_by_key(|(generic, operation)| (*generic, operation.id.clone()));
        if fitting.is_empty() {
            let shown = path.display();
            let held = self.catalogue().withheld_file(&name, OperationKind::Reader);
            if let Some(failure) = held {
                return Err(failure.context(format!("cannot read {shown}")));
            }
            let message = if readers().next().is_none() {
                format!("cannot read {shown}: no reader installed")
            } else {
                format!("cannot read {shown}: no reader installed for this kind of file")
            };
            return Err(Failure::new(FailureCode::Unsupported, message)
                .remedy("puncta ops lists the readers; install a plugin that reads it"));
        }
        Ok(fitting)
    }
}

/// A reader that did not refuse, with what it said of the file.
fn able_to(operation: &Operation, call: PreparedCall) -> Able<PreparedCall> {
    let probe = call.plan().probe.clone();
    let (format, confidence) = probe.map_or((String::new(), 0.0), |p| (p.format, p.confidence));
    Able {
        id: operation.id.clone(),
        format,
        confidence,
        call,
    }
}

fn look(path: &Path) -> Result<(FileRef, Vec<u8>), Failure> {
    let failed = |error: &std::io::Error| Failure::io("read", path, error);
    let metadata = path.metadata().map_err(|error| failed(&error))?;
    if metadata.is_dir() {
        let message = format!("cannot read {}: it is a folder", path.display());
        return Err(Failure::new(FailureCode::Io, message).remedy("name a file in it"));
    }
    if metadata.len() == 0 && metadata.is_file() {
        return Err(Failure::bad_file(format!("{} is empty", path.display())));
    }
    let file = std::fs::File::open(path).map_err(|error| failed(&error))?;
    let mut head = Vec::new();
    file.take(64)
        .read_to_end(&mut head)
        .map_err(|error| failed(&error))?;
    let absolute = std::path::absolute(path).map_err(|error| failed(&error))?;
    let text = absolute.to_str().ok_or_else(|| {
        let message = format!("the name of {} is no valid text", path.display());
        Failure::new(FailureCode::Io, message).remedy("rename it")
    })?;
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    let size = Some(metadata.len());
    Ok((
        FileRef {
            path: text.into(),
            name: name.unwrap_or_default(),
            size,
        },
        head,
    ))
}

fn starts_with(head: &[u8], magic: &str) -> bool {
    let magic = magic.as_bytes();
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let (pairs, rest) = magic.as_chunks::<2>();
    !pairs.is_empty()
        && rest.is_empty()
        && head.len() >= pairs.len()
        && pairs.iter().zip(head).all(|([high, low], byte)| {
            matches!((digit(*high), digit(*low)), (Some(h), Some(l)) if h * 16 + l == u32::from(*byte))
        })
}

impl ReadFile {
    /// The only object, or the one that is named.
    ///
    /// # Errors
    /// When there is none of that name; without a name, the first is taken.
    pub fn object(&self, name: Option<&str>) -> Result<&Object, Failure> {
        let found = match name {
            None => self.objects.first(),
            Some(name) => self.objects.iter().find(|(known, _)| known == name),
        };
        found.map(|(_, object)| object).ok_or_else(|| {
            let names: Vec<&str> = self.objects.iter().map(|(name, _)| name.as_str()).collect();
            let message = match name {
                Some(name) => format!("the file holds no object {name}"),
                None => "the file holds nothing".into(),
            };
            Failure::bad_input(message).remedy(format!("it holds {}", names.join(", ")))
        })
    }
}

impl From<Called> for Vec<(String, Object)> {
    fn from(called: Called) -> Self {
        called.outputs
    }
}
