//! `bundle.json`: the libraries that belong to the bundle which this program is in.

use crate::kept::read_text;
use puncta_documents::{Failure, Map};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Format of `bundle.json`.
pub const BUNDLE: &str = "puncta.bundle/1";
/// Name of the list in the bundle's plugin folder.
pub const FILE_NAME: &str = "bundle.json";

/// The bundle's libraries by BLAKE3.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Listed {
    /// Libraries by hash.
    pub libraries: BTreeMap<String, Library>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// A library of the bundle.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Library {
    /// Its path in the plugin folder, for people.
    pub file: String,
    /// Its size in bytes.
    pub size: u64,
}

/// Reads the list of a bundle's plugin folder. Without one, nothing is listed.
///
/// # Errors
/// When it is damaged; the sentence names it.
pub fn read(folder: &Path) -> Result<Listed, Failure> {
    let path = folder.join(FILE_NAME);
    match read_text(&path) {
        Ok(text) => puncta_documents::parse(&text, BUNDLE).map_err(|why| {
            Failure::bad_file(format!("{} is {why}", path.display()))
                .remedy("install the program again")
        }),
        Err(None) => Ok(Listed::default()),
        Err(Some(failure)) => Err(failure),
    }
}
