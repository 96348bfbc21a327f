//! A file that was written, as text and as JSON.

use crate::output::{count, plain};
use puncta_engine::documents::Kind;
use puncta_engine::headless::Saved;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// As JSON.
pub fn json(saved: &Saved) -> Value {
    let shown = |path: &PathBuf| clean(path).display().to_string();
    json!({
        "file": saved.path.display().to_string(),
        "files": saved.written.files.iter().map(shown).collect::<Vec<_>>(),
        "provenance": saved.provenance.as_ref().map(shown),
        "kind": saved.header.kind,
        "rows": saved.header.rows(),
        "writer": saved.written.writer,
        "parameters": saved.written.parameters,
    })
}

/// As a line.
pub fn text(saved: &Saved) -> String {
    let size = match (saved.header.kind, &saved.header.image) {
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
            format!(", {} {rows}", count(saved.header.rows()))
        }
    };
    let path = plain(&saved.path.display().to_string());
    format!("{path}: {}{size}\n", saved.header.kind)
}

/// Without a leading `./`.
fn clean(path: &Path) -> &Path {
    path.strip_prefix(".").unwrap_or(path)
}
