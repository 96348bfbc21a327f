//! `plugin.json`: what a library offers, described once in a worker that is thrown away.

use super::inspect::{hex, inspect};
use super::library_file::Facts;
use crate::kept::read_text;
use crate::worker::Pool;
use puncta_documents::{Failure, FailureCode, Manifest, Map};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Format of `plugin.json`.
pub const INSTALLED: &str = "puncta.installed/1";
/// Name of the file that `puncta plugins pack` writes beside a library.
pub const FILE_NAME: &str = "plugin.json";

/// What `plugin.json` says: the manifest, and which library it was taken from.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Packed {
    /// File name of the library, in the same folder.
    pub library: String,
    /// BLAKE3 of the library.
    pub hash: String,
    /// Whether the library has the door.
    pub door: bool,
    /// What the plugin is and offers.
    pub manifest: Manifest,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// Reads the `plugin.json` of a folder.
///
/// # Errors
/// When it is damaged, or names a library elsewhere.
pub fn read(folder: &Path) -> Result<Packed, Failure> {
    let path = folder.join(FILE_NAME);
    let none = || Failure::bad_file(format!("{} is not there", path.display()));
    let text = read_text(&path).map_err(|failure| failure.unwrap_or_else(none))?;
    let packed: Packed = puncta_documents::parse(&text, INSTALLED).map_err(|why| {
        Failure::bad_file(format!("{} is {why}", path.display()))
            .remedy("run puncta plugins pack on the library again")
    })?;
    let name = Path::new(&packed.library);
    if name.file_name() != Some(name.as_os_str()) {
        let message = format!("{} names a library in another folder", path.display());
        return Err(Failure::bad_file(message));
    }
    Ok(packed)
}

/// Describes a library in a worker that is thrown away. This runs code of the library.
///
/// # Errors
/// One sentence: what the file is instead of a plugin, or how describing it failed.
pub fn describe(library: &Path, pool: &Pool) -> Result<Packed, Failure> {
    let bytes = fs::read(library).map_err(|error| Failure::io("read", library, &error))?;
    let inspected = inspect(library, &bytes)?;
    let manifest = pool.describe(library, inspected.door)?;
    let name = library
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    Ok(Packed {
        library: name.unwrap_or_default(),
        hash: hex(&inspected.hash),
        door: inspected.door,
        manifest,
        rest: Map::new(),
    })
}

/// Describes a library and writes `plugin.json` beside it. Returns the file's path.
///
/// # Errors
/// As [`describe`], or when the file cannot be written.
pub fn pack(library: &Path, pool: &Pool) -> Result<(PathBuf, Packed), Failure> {
    let packed = describe(library, pool)?;
    let path = library.with_file_name(FILE_NAME);
    let text = puncta_documents::write(&packed, INSTALLED);
    crate::files::write_whole(&path, text.as_bytes())?;
    Ok((path, packed))
}

/// A private copy of a library in the cache folder, kept by its hash, so that nobody can change
/// what is mapped.
///
/// # Errors
/// When the library has another hash now, or cannot be copied.
pub fn private_copy(library: &Path, hash: &str, cache: &Path) -> Result<PathBuf, Failure> {
    let bytes = fs::read(library).map_err(|error| Failure::io("read", library, &error))?;
    let inspected = inspect(library, &bytes)?;
    let shown = library.display();
    if hex(&inspected.hash) != hash {
        let message = format!("{shown} has changed since it was packed");
        return Err(Failure::new(FailureCode::Unsupported, message)
            .remedy(format!("if you trust it, run puncta plugins trust {shown}")));
    }
    let folder = cache.join("plugins").join(hash.get(..16).unwrap_or(hash));
    let copy = folder.join(library.file_name().unwrap_or_default());
    let same = fs::read(&copy).is_ok_and(|there| there == bytes);
    if !same {
        fs::create_dir_all(&folder).map_err(|e| Failure::io("create", &folder, &e))?;
        crate::files::write_whole(&copy, &bytes)?;
    }
    Ok(copy)
}

/// What a trusted library offers, from the cache or from a worker that is thrown away.
///
/// # Errors
/// As [`describe`], or when the library is another one by now.
pub fn remembered(library: &Path, facts: &Facts, source: &Describer) -> Result<Packed, Failure> {
    let path = source
        .cache
        .join("described")
        .join(format!("{}.json", facts.hash));
    let known = read_text(&path).ok();
    let known = known.and_then(|text| puncta_documents::parse::<Packed>(&text, INSTALLED).ok());
    let name = library.file_name().unwrap_or_default().to_string_lossy();
    if let Some(mut packed) = known.filter(|one| one.hash == facts.hash) {
        packed.library = name.into_owned();
        return Ok(packed);
    }
    let copy = private_copy(library, &facts.hash, &source.cache)?;
    let packed = describe(&copy, &source.workers)?;
    let text = puncta_documents::write(&packed, INSTALLED);
    // Where nothing can be remembered, it is described again next time.
    let folder = crate::files::folder_of(&path);
    if fs::create_dir_all(folder).is_ok() {
        let _ = crate::files::write_whole(&path, text.as_bytes());
    }
    Ok(packed)
}

/// Where and how trusted libraries without a `plugin.json` are described.
pub struct Describer {
    /// Folder for private copies and descriptions.
    pub cache: PathBuf,
    /// Workers that describe.
    pub workers: Arc<Pool>,
}
