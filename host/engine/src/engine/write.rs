//! Writing files: which writer, and nothing half-written.

use super::{Engine, Invocation};
use crate::files::Staging;
use crate::job::Progress;
use crate::store::Object;
use puncta_documents::{Failure, FailureCode, FileRef, Map, Operation, OperationKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file that was written.
#[derive(Clone, Debug)]
pub struct Written {
    /// The file, then those beside it.
    pub files: Vec<PathBuf>,
    /// Writer that was used.
    pub writer: String,
    /// Its parameters after defaults.
    pub parameters: Map,
}

impl Engine {
    /// The writer for an object and a file name.
    ///
    /// # Errors
    /// When none is installed that writes such objects into such files.
    pub fn writer(
        &self,
        path: &Path,
        writer: Option<&str>,
        object: &Object,
    ) -> Result<&Operation, Failure> {
        let kind = object.header().kind;
        let takes = |operation: &Operation| operation.inputs.iter().any(|port| port.kind == kind);
        if let Some(id) = writer {
            let (_, operation) = self.operation(id)?;
            if operation.kind != OperationKind::Writer || !takes(operation) {
                let message = format!("{} does not write a {kind}", operation.id);
                return Err(Failure::new(FailureCode::BadParameter, message));
            }
            return Ok(operation);
        }
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .to_lowercase();
        let mut writers = self
            .catalogue()
            .operations()
            .map(|(_, operation)| operation)
            .filter(|operation| operation.kind == OperationKind::Writer && takes(operation));
        let fits = |operation: &&Operation| {
            let rule = operation.file.as_ref();
            rule.is_some_and(|rule| rule.suffixes.iter().any(|one| name.ends_with(one.as_str())))
        };
        writers.find(fits).ok_or_else(|| {
            let held = self.catalogue().withheld_file(&name, OperationKind::Writer);
            if let Some(failure) = held {
                return failure.context(format!("cannot write {}", path.display()));
            }
            let mut suffixes: Vec<String> = self
                .catalogue()
                .operations()
                .filter(|(_, o)| o.kind == OperationKind::Writer && takes(o))
                .filter_map(|(_, operation)| operation.file.as_ref())
                .flat_map(|rule| rule.suffixes.iter().cloned())
                .collect();
            suffixes.sort();
            suffixes.dedup();
            let message = format!(
                "no writer installed that writes a {kind} as {}",
                path.display()
            );
            let remedy = match suffixes.as_slice() {
                [] => format!("install a plugin that writes a {kind}"),
                suffixes => format!("there are writers for {}", suffixes.join(", ")),
            };
            Failure::new(FailureCode::Unsupported, message).remedy(remedy)
        })
    }

    /// Writes an object to a file. The file is there whole afterwards, or untouched.
    ///
    /// # Errors
    /// When the file exists and `overwrite` is not set, no writer fits, or writing fails.
    pub fn write(
        &self,
        path: &Path,
        writer: Option<&str>,
        parameters: &Map,
        object: &Object,
        overwrite: bool,
        progress: &Arc<dyn Progress>,
    ) -> Result<Written, Failure> {
        let operation = self.writer(path, writer, object)?;
        if !overwrite && path.exists() {
            let message = format!("{} exists already", path.display());
            return Err(Failure::new(FailureCode::Io, message)
                .remedy("choose another name, or add --overwrite"));
        }
        let staging = Staging::new(path)?;
        let place = std::path::absolute(staging.path())
            .map_err(|error| Failure::io("write", path, &error))?;
        let port = operation
            .inputs
            .iter()
            .find(|port| port.kind == object.header().kind);
        let port = port.ok_or_else(|| Failure::internal("a writer without inputs"))?;
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let path_text = place.to_str().ok_or_else(|| {
            let message = format!("the name of {} is no valid text", path.display());
            Failure::new(FailureCode::Io, message).remedy("choose another name")
        })?;
        let invocation = Invocation {
            operation: operation.id.clone(),
            parameters: parameters.clone(),
            inputs: vec![(port.name.clone(), object.clone())],
            file: Some(FileRef {
                path: path_text.into(),
                name,
                size: None,
            }),
        };
        let called = self.call(&invocation, progress).map_err(|mut failure| {
            // The person knows nothing of the staging folder.
            failure.message = failure
                .message
                .replace(path_text, &path.display().to_string());
            failure
        })?;
        let files = staging.publish()?;
        Ok(Written {
            files,
            writer: operation.id.clone(),
            parameters: called.parameters,
        })
    }
}
