//! Small JSON documents that several processes read and change: settings, and what went wrong.

use crate::files::write_whole;
use puncta_documents::{Failure, Map};
use serde::{Serialize, de::DeserializeOwned};
use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

/// A document in a file. Reading waits for nobody: the file is replaced as a whole. Changes of
/// several processes follow each other, held apart by a lock on a file beside it.
#[derive(Clone, Debug)]
pub struct Kept<T> {
    path: PathBuf,
    format: &'static str,
    /// What the person calls it, such as `settings`.
    what: &'static str,
    _document: PhantomData<fn() -> T>,
}

/// Holds others off until it is dropped.
pub struct Turn(File);

impl Drop for Turn {
    fn drop(&mut self) {
        // Closing the file would do the same.
        let _ = self.0.unlock();
    }
}

impl<T: Serialize + DeserializeOwned + Default> Kept<T> {
    /// The document at `path`, which need not be there.
    #[must_use]
    pub fn new(path: PathBuf, format: &'static str, what: &'static str) -> Kept<T> {
        Kept {
            path,
            format,
            what,
            _document: PhantomData,
        }
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads it. A file that is not there is an empty document.
    ///
    /// # Errors
    /// When the file is damaged, too large or cannot be read; the sentence names it.
    pub fn read(&self) -> Result<T, Failure> {
        match read_text(&self.path) {
            Ok(text) => puncta_documents::parse(&text, self.format).map_err(|why| {
                let path = self.path.display();
                Failure::bad_file(format!("the {} in {path} are damaged: {why}", self.what))
                    .remedy("mend the file, or move it away to begin anew")
            }),
            Err(None) => Ok(T::default()),
            Err(Some(failure)) => Err(failure),
        }
    }

    /// Changes it; nobody else changes it at the same time.
    ///
    /// # Errors
    /// As [`Kept::read`], what `change` refuses, or when the file cannot be written. The file is
    /// then as it was.
    pub fn change<R>(
        &self,
        change: impl FnOnce(&mut T) -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        self.change_in(&self.turn()?, change)
    }

    /// As [`Kept::change`], for who already holds others off.
    ///
    /// # Errors
    /// As [`Kept::change`].
    pub fn change_in<R>(
        &self,
        _turn: &Turn,
        change: impl FnOnce(&mut T) -> Result<R, Failure>,
    ) -> Result<R, Failure> {
        let mut document = self.read()?;
        let result = change(&mut document)?;
        let text = puncta_documents::write(&document, self.format);
        // Written for people too, who may mend it.
        let value: Map = serde_json::from_str(&text)
            .map_err(|error| Failure::internal(format!("the {}: {error}", self.what)))?;
        let text = format!("{:#}\n", serde_json::Value::Object(value));
        write_whole(&self.path, text.as_bytes())?;
        Ok(result)
    }

    /// Waits until nobody else changes it.
    ///
    /// # Errors
    /// When its folder cannot be made or written.
    pub fn turn(&self) -> Result<Turn, Failure> {
        let folder = crate::files::folder_of(&self.path);
        fs::create_dir_all(folder).map_err(|error| Failure::io("make", folder, &error))?;
        let path = self.path.with_extension("lock");
        let failed = |error: &std::io::Error| Failure::io("lock", &path, error);
        let mut open = File::options();
        let file = open.create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(|error| failed(&error))?;
        match file.lock() {
            Ok(()) => Ok(Turn(file)),
            // A file system without locks: two that write at the same moment are very rare.
            Err(error) if error.kind() == ErrorKind::Unsupported => Ok(Turn(file)),
            Err(error) => Err(failed(&error)),
        }
    }
}

/// The text of a document's file; nothing if there is no such file.
///
/// # Errors
/// When it cannot be read, is no text, or is larger than any document.
pub fn read_text(path: &Path) -> Result<String, Option<Failure>> {
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => None,
        _ => Some(Failure::io("read", path, &error)),
    };
    let file = File::open(path).map_err(failed)?;
    let most = puncta_documents::MAX_TEXT as u64;
    let mut bytes = Vec::new();
    file.take(most + 1)
        .read_to_end(&mut bytes)
        .map_err(failed)?;
    let shown = path.display();
    if bytes.len() as u64 > most {
        let message = format!("{shown} is larger than {} MB", most >> 20);
        return Err(Some(
            Failure::bad_file(message).remedy("no document of this program is so large"),
        ));
    }
    String::from_utf8(bytes)
        .map_err(|_| Some(Failure::bad_file(format!("{shown} is no UTF-8 text"))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const FORMAT: &str = "puncta.numbers/1";
    type Numbers = BTreeMap<String, serde_json::Value>;

    fn kept(folder: &Path) -> Kept<Numbers> {
        Kept::new(folder.join("deep").join("numbers.json"), FORMAT, "numbers")
    }

    #[test]
    fn changes_of_many_at_once_are_all_kept() {
        let folder = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for i in 0..16_u32 {
                let kept = kept(folder.path());
                scope.spawn(move || {
                    kept.change(|numbers| {
                        numbers.insert(format!("n{i}"), i.into());
                        Ok(())
                    })
                    .unwrap();
                });
            }
        });
        let numbers = kept(folder.path()).read().unwrap();
        assert_eq!(
            numbers.keys().filter(|key| key.starts_with('n')).count(),
            16
        );
    }

    #[test]
    fn a_damaged_file_is_named_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let kept = kept(folder.path());
        kept.change(|_| Ok(())).unwrap();
        for text in [
            "{",
            "",
            "[1]",
            "{\"format\": \"puncta.other/1\"}",
            &format!("{{\"format\": \"{FORMAT}\", \"a\": {}", "[".repeat(5000)),
        ] {
            fs::write(kept.path(), text).unwrap();
            let sentence = kept.change(|_| Ok(())).unwrap_err().to_string();
            assert!(
                sentence.contains("numbers.json") && sentence.contains("damaged"),
                "{sentence}"
            );
            assert_eq!(fs::read_to_string(kept.path()).unwrap(), text);
        }
        fs::write(kept.path(), [0xff, 0xfe]).unwrap();
        assert!(kept.read().unwrap_err().to_string().contains("UTF-8"));
        let large = File::create(kept.path()).unwrap();
        large.set_len(1 << 30).unwrap();
        assert!(kept.read().unwrap_err().to_string().contains("larger than"));
    }

    #[test]
    fn what_is_refused_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let kept = kept(folder.path());
        let refused = kept.change(|numbers| -> Result<(), Failure> {
            numbers.insert("a".into(), 1.into());
            Err(Failure::bad_input("no"))
        });
        assert!(refused.is_err() && kept.read().unwrap().is_empty());
    }
}
