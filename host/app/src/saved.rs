//! A file that was written, with its provenance, as text and as JSON.

use crate::context::{Context, located, name};
use crate::output::{count, plain};
use puncta_engine::documents::{Failure, Header, Kind, Map};
use puncta_engine::provenance::Lineage;
use puncta_engine::{Object, Written};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A file that was written.
pub struct Saved {
    path: PathBuf,
    header: Header,
    written: Written,
    provenance: Option<PathBuf>,
}

impl Saved {
    /// Writes an object.
    pub fn write(
        context: &Context,
        path: &Path,
        writer: Option<&str>,
        options: &Map,
        object: &Object,
        overwrite: bool,
    ) -> Result<Saved, Failure> {
        context.watch.begin(&format!("writing {}", name(path)));
        let progress = context.progress();
        let written = context
            .engine
            .save(path, writer, options, object, overwrite, &progress);
        context.watch.end();
        let written = written.map_err(|failure| located(failure, path))?;
        let header = object.header().clone();
        Ok(Saved {
            path: path.to_owned(),
            header,
            written,
            provenance: None,
        })
    }

    /// Writes what it was made of beside it.
    pub fn with_provenance(mut self, context: &Context, made: Lineage) -> Result<Saved, Failure> {
        let progress = context.progress();
        let path = context
            .engine
            .write_provenance(&self.written, made, &*progress)?;
        self.provenance = Some(path);
        Ok(self)
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        let shown = |path: &PathBuf| clean(path).display().to_string();
        json!({
            "file": self.path.display().to_string(),
            "files": self.written.files.iter().map(shown).collect::<Vec<_>>(),
            "provenance": self.provenance.as_ref().map(shown),
            "kind": self.header.kind,
            "rows": self.header.rows(),
            "writer": self.written.writer,
            "parameters": self.written.parameters,
        })
    }

    /// As a line.
    pub fn text(&self) -> String {
        let size = match (self.header.kind, &self.header.image) {
            (Kind::Image, Some(image)) => {
                let [t, c, z, y, x] = image.size;
                let size = [x, y, z, c, t].map(|size| size.to_string());
                let used = [x, y, z, c, t]
                    .iter()
                    .rposition(|size| *size != 1)
                    .unwrap_or(0)
                    .max(1);
                format!(
                    ", {}",
                    size.iter()
                        .take(used + 1)
                        .cloned()
                        .collect::<Vec<_>>()
                        .join(" x ")
                )
            }
            (Kind::Figure | Kind::Report, _) => String::new(),
            (kind, _) => {
                let rows = if kind == Kind::Mesh {
                    "vertices"
                } else {
                    "rows"
                };
                format!(", {} {rows}", count(self.header.rows()))
            }
        };
        let path = plain(&self.path.display().to_string());
        format!("{path}: {}{size}\n", self.header.kind)
    }
}

/// Without a leading `./`.
fn clean(path: &Path) -> &Path {
    path.strip_prefix(".").unwrap_or(path)
}
