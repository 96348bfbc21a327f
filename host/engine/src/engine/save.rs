//! Saving: a writer for data, plain JSON for figures and reports.

use super::{Engine, Written};
use crate::files;
use crate::job::Progress;
use crate::store::Object;
use puncta_documents::{Failure, FailureCode, Header, Kind, Map};
use std::path::Path;
use std::sync::Arc;

/// Suffix of the files in which figures and reports are saved as they are.
const DOCUMENT: &str = ".json";

impl Engine {
    /// Whether an object of a kind could be saved as this file, told before there is one.
    ///
    /// # Errors
    /// When no writer is installed for it.
    pub fn can_save(&self, path: &Path, writer: Option<&str>, kind: Kind) -> Result<(), Failure> {
        let object = Object::new(Header::new(kind, ""), Vec::new())?;
        match self.writer(path, writer, &object) {
            Err(_) if writer.is_none() && is_document(path, kind) => Ok(()),
            found => found.map(|_| ()),
        }
    }

    /// Saves an object: with a writer; a figure or a report for which none is installed as JSON.
    /// [`Written::writer`] is then empty.
    ///
    /// # Errors
    /// As [`Engine::write`].
    pub fn save(
        &self,
        path: &Path,
        writer: Option<&str>,
        parameters: &Map,
        object: &Object,
        overwrite: bool,
        progress: &Arc<dyn Progress>,
    ) -> Result<Written, Failure> {
        let header = object.header();
        let Some(document) = header.document.as_ref().filter(|_| {
            writer.is_none()
                && is_document(path, header.kind)
                && self.writer(path, None, object).is_err()
        }) else {
            return self.write(path, writer, parameters, object, overwrite, progress);
        };
        if let Some(name) = parameters.keys().next() {
            let message = format!("a {} saved as JSON has no option {name}", header.kind);
            return Err(Failure::bad_parameter(name, message).remedy("leave it out"));
        }
        if !overwrite && path.exists() {
            let message = format!("{} exists already", path.display());
            return Err(Failure::new(FailureCode::Io, message)
                .remedy("choose another name, or add --overwrite"));
        }
        files::write_whole(path, format!("{document:#}\n").as_bytes())?;
        let files = vec![path.to_path_buf()];
        Ok(Written {
            files,
            writer: String::new(),
            parameters: Map::new(),
        })
    }
}

pub(super) fn is_document(path: &Path, kind: Kind) -> bool {
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    matches!(kind, Kind::Figure | Kind::Report) && name.ends_with(DOCUMENT)
}
