//! Copying folders, and replacing one as a whole.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

/// Copies a file, making the folders above it.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    if let Some(folder) = to.parent() {
        make_folder(folder)?;
    }
    fs::copy(from, to)
        .with_context(|| format!("cannot copy {} to {}", from.display(), to.display()))?;
    Ok(())
}

/// Copies a folder of sources: everything but build output and hidden files.
pub fn copy_sources(from: &Path, to: &Path) -> Result<()> {
    make_folder(to)?;
    let entries = fs::read_dir(from).with_context(|| format!("cannot read {}", from.display()))?;
    for entry in entries {
        let entry = entry.with_context(|| format!("cannot read {}", from.display()))?;
        let name = entry.file_name();
        if name == "target" || name.to_string_lossy().starts_with('.') {
            continue;
        }
        let (source, place) = (entry.path(), to.join(&name));
        if source.is_dir() {
            copy_sources(&source, &place)?;
        } else {
            copy(&source, &place)?;
        }
    }
    Ok(())
}

pub fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", path.display()))
}

/// Removes a folder if it is there.
pub fn remove_folder(path: &Path) -> Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// A folder that is filled beside its final place and put there in one step; what it was is removed when that fails.
pub struct Staged {
    place: PathBuf,
    work: PathBuf,
}

impl Staged {
    pub fn new(place: &Path) -> Result<Self> {
        let staged = Self {
            place: place.to_path_buf(),
            work: beside(place, "new"),
        };
        remove_folder(&staged.work)?;
        make_folder(&staged.work)?;
        Ok(staged)
    }

    pub fn path(&self) -> &Path {
        &self.work
    }

    /// Takes the final place; the folder that was there is removed.
    pub fn finish(self) -> Result<()> {
        let old = beside(&self.place, "old");
        remove_folder(&old)?;
        if self.place.exists() {
            fs::rename(&self.place, &old)
                .with_context(|| format!("cannot move {} away", self.place.display()))?;
        }
        fs::rename(&self.work, &self.place)
            .with_context(|| format!("cannot put {} in place", self.place.display()))?;
        remove_folder(&old)
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        // After `finish` the folder is no longer there; a failed removal leaves a stray folder and nothing worse.
        let _ = remove_folder(&self.work);
    }
}

fn beside(place: &Path, mark: &str) -> PathBuf {
    let name = place.file_name().unwrap_or_default().to_string_lossy();
    place.with_file_name(format!("{name}.{mark}-{}", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Result<Vec<String>> {
        let mut names = Vec::new();
        for entry in fs::read_dir(folder)? {
            names.push(entry?.file_name().to_string_lossy().into_owned());
        }
        names.sort();
        Ok(names)
    }

    #[test]
    fn a_staged_folder_replaces_the_old_one_and_leaves_nothing_behind() -> Result<()> {
        let root = tempfile::tempdir()?;
        let place = root.path().join("bundle");
        for text in ["first", "second"] {
            let staged = Staged::new(&place)?;
            fs::write(staged.path().join(text), text)?;
            staged.finish()?;
            assert_eq!(names(&place)?, [text]);
        }
        drop(Staged::new(&place)?);
        assert_eq!(names(root.path())?, ["bundle"]);
        assert_eq!(names(&place)?, ["second"]);
        Ok(())
    }

    #[test]
    fn sources_are_copied_without_build_output() -> Result<()> {
        let root = tempfile::tempdir()?;
        let from = root.path().join("from");
        for file in ["src/lib.rs", "target/debug/x", ".git/HEAD", "Cargo.toml"] {
            let path = from.join(file);
            make_folder(path.parent().context("a parent")?)?;
            fs::write(path, file)?;
        }
        let to = root.path().join("to");
        copy_sources(&from, &to)?;
        assert_eq!(names(&to)?, ["Cargo.toml", "src"]);
        assert_eq!(fs::read_to_string(to.join("src/lib.rs"))?, "src/lib.rs");
        Ok(())
    }
}
