//! What can be said of a library without running anything of it: hash, size, where it came from.

use super::inspect::{Inspected, hex, inspect};
use puncta_documents::Failure;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

/// A library file as it is now.
#[derive(Clone, Debug)]
pub struct Facts {
    /// BLAKE3 of its bytes.
    pub hash: String,
    /// Whether it has the door.
    pub door: bool,
    /// Bytes.
    pub size: u64,
    /// When it was changed last, in UTC.
    pub modified: Option<String>,
    /// Address that it was downloaded from, where the system remembers it.
    pub origin: Option<String>,
}

impl Facts {
    /// Reads and inspects a library.
    ///
    /// # Errors
    /// When it cannot be read, or is no library of this system with a plugin.
    pub fn of(library: &Path) -> Result<Facts, Failure> {
        let bytes = fs::read(library).map_err(|error| Failure::io("read", library, &error))?;
        let Inspected { hash, door } = inspect(library, &bytes)?;
        let modified = fs::metadata(library).and_then(|found| found.modified());
        Ok(Facts {
            hash: hex(&hash),
            door,
            size: bytes.len() as u64,
            modified: modified.ok().map(|time: SystemTime| crate::date::utc(time)),
            origin: origin(library),
        })
    }

    /// The beginning of the hash, for people.
    #[must_use]
    pub fn short(&self) -> &str {
        short(&self.hash)
    }
}

/// The beginning of a hash, for people.
#[must_use]
pub fn short(hash: &str) -> &str {
    hash.get(..16).unwrap_or(hash)
}

/// Browsers and download tools leave the address in an extended attribute.
#[cfg(target_os = "linux")]
fn origin(path: &Path) -> Option<String> {
    let mut buffer = [0_u8; 2048];
    let count = rustix::fs::getxattr(path, "user.xdg.origin.url", &mut buffer[..]).ok()?;
    let text = String::from_utf8_lossy(buffer.get(..count)?);
    let text = text.trim_matches(['\0', ' ']);
    (!text.is_empty()).then(|| text.to_owned())
}

#[cfg(not(target_os = "linux"))]
fn origin(_path: &Path) -> Option<String> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn the_address_of_a_download_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.so");
        fs::write(&file, "x").unwrap();
        assert_eq!(origin(&file), None);
        let url = "https://example.org/a.so";
        let flags = rustix::fs::XattrFlags::empty();
        // Some file systems keep no attributes.
        if rustix::fs::setxattr(&file, "user.xdg.origin.url", url.as_bytes(), flags).is_ok() {
            assert_eq!(origin(&file).as_deref(), Some(url));
        }
        assert_eq!(short(&"ab".repeat(32)), "abababababababab");
    }
}
