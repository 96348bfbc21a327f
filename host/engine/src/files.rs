//! Files that are either whole or not there.

use puncta_documents::{Failure, FailureCode};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes a file whole: to a temporary name in the same folder, synced, then renamed.
///
/// # Errors
/// When the folder cannot be written or the disk is full; the old file is then untouched.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let failed = |error: &std::io::Error| Failure::io("write", path, error);
    let folder = folder_of(path);
    let mut file = tempfile::Builder::new()
        .prefix(".puncta-")
        .tempfile_in(folder)
        .map_err(|error| failed(&error))?;
    file.write_all(bytes).map_err(|error| failed(&error))?;
    file.as_file().sync_all().map_err(|error| failed(&error))?;
    make_public(file.path());
    file.persist(path).map_err(|error| failed(&error.error))?;
    Ok(())
}

/// Folder of a path, `.` for a bare name.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Refuses to write over a file, or into a folder that is not there, before anything is computed.
///
/// # Errors
/// What stands in the way.
pub fn check_target(path: &Path, overwrite: bool) -> Result<(), Failure> {
    let refuse = |what: &str, remedy: &str| {
        let message = format!("cannot write {}: {what}", path.display());
        Err(Failure::new(FailureCode::Io, message).remedy(remedy))
    };
    let folder = folder_of(path);
    if path.is_dir() {
        return refuse("it is a folder", "name a file in it");
    }
    if !folder.is_dir() {
        return refuse("its folder is not there", "make the folder first");
    }
    if !overwrite && path.exists() {
        return refuse(
            "it exists already",
            "choose another name, or add --overwrite",
        );
    }
    Ok(())
}

/// Refuses a path below `folder` that leads out of it through a symbolic link. The last part may be
/// a link: files are put in its place, not written through it.
///
/// # Errors
/// A sentence that names the link.
pub fn check_below(folder: &Path, path: &Path) -> Result<(), Failure> {
    let refuse = |place: &Path| {
        let (path, place) = (path.display(), place.display());
        let message = format!("cannot write {path}: {place} is a link out of the output folder");
        Err(Failure::new(FailureCode::Io, message)
            .remedy("remove the link, or choose another folder with --out"))
    };
    let Ok(inside) = path.strip_prefix(folder) else {
        return refuse(path);
    };
    // In a folder that is not there are no links.
    let Ok(root) = folder_or_here(folder).canonicalize() else {
        return Ok(());
    };
    let mut place = folder.to_path_buf();
    for part in inside.parent().into_iter().flat_map(Path::components) {
        place.push(part);
        match place.canonicalize() {
            Ok(real) if real.starts_with(&root) => {}
            Ok(_) => return refuse(&place),
            // It leads nowhere, and would once somebody made its target.
            Err(_) if place.is_symlink() => return refuse(&place),
            Err(_) => return Ok(()),
        }
    }
    Ok(())
}

fn folder_or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    }
}

/// Temporary files are private; what the person asked for has the usual permissions.
#[cfg(unix)]
fn make_public(path: &Path) {
    use std::os::unix::fs::PermissionsExt;
    // A file system without permissions leaves them as they are.
    let _ = fs::set_permissions(path, fs::Permissions::from_mode(0o644));
}

#[cfg(not(unix))]
fn make_public(_path: &Path) {}

/// A folder beside the destination in which a writer works; its files move when all is done.
pub struct Staging {
    folder: tempfile::TempDir,
    destination: PathBuf,
}

impl Staging {
    /// A staging folder for writing `destination`.
    ///
    /// # Errors
    /// When the destination's folder cannot be written, or the destination is a folder.
    pub fn new(destination: &Path) -> Result<Staging, Failure> {
        if destination.is_dir() {
            return Err(Failure::new(
                FailureCode::Io,
                format!("cannot write {}: it is a folder", destination.display()),
            ));
        }
        let folder = folder_of(destination);
        let made = tempfile::Builder::new()
            .prefix(".puncta-")
            .tempdir_in(folder);
        let made = made.map_err(|error| Failure::io("write in", folder, &error))?;
        Ok(Staging {
            folder: made,
            destination: destination.into(),
        })
    }

    /// Where to write.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.folder
            .path()
            .join(self.destination.file_name().unwrap_or_default())
    }

    /// Moves what was written to its place, the asked-for file last. Returns all paths.
    ///
    /// # Errors
    /// When the asked-for file was not written, or a move fails.
    pub fn publish(self) -> Result<Vec<PathBuf>, Failure> {
        let main = self.path();
        if !main.is_file() {
            let message = format!("{} was not written", self.destination.display());
            return Err(Failure::internal(message));
        }
        let failed = |error: std::io::Error| Failure::io("write", &self.destination, &error);
        let mut files: Vec<PathBuf> = fs::read_dir(self.folder.path())
            .map_err(failed)?
            .flatten()
            .map(|entry| entry.path())
            .collect();
        files.sort_by_key(|path| (*path == main, path.clone()));
        let folder = folder_of(&self.destination);
        let mut published = Vec::new();
        for file in files {
            let place = folder.join(file.file_name().unwrap_or_default());
            make_public(&file);
            fs::File::open(&file)
                .and_then(|file| file.sync_all())
                .map_err(failed)?;
            fs::rename(&file, &place).map_err(failed)?;
            published.push(place);
        }
        published.reverse();
        Ok(published)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_checked_first() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        assert!(check_target(&file, false).is_ok());
        std::fs::write(&file, "x").unwrap();
        let sentence = |path: &Path| check_target(path, false).unwrap_err().to_string();
        assert!(
            sentence(&file).contains("exists already; choose another name, or add --overwrite")
        );
        assert!(check_target(&file, true).is_ok());
        assert!(sentence(folder.path()).contains("is a folder"));
        assert!(sentence(&folder.path().join("no/a.csv")).contains("folder is not there"));
    }

    #[cfg(unix)]
    #[test]
    fn links_do_not_lead_out_of_a_folder() {
        use std::os::unix::fs::symlink;
        let place = tempfile::tempdir().unwrap();
        let out = place.path().join("out");
        fs::create_dir_all(out.join("real/deep")).unwrap();
        symlink(place.path(), out.join("up")).unwrap();
        symlink("real", out.join("inside")).unwrap();
        symlink(place.path().join("nowhere"), out.join("dangling")).unwrap();
        symlink(place.path().join("x"), out.join("file.csv")).unwrap();
        for good in [
            "a.csv",
            "new/a.csv",
            "real/a.csv",
            "inside/deep/a.csv",
            "file.csv",
        ] {
            assert!(check_below(&out, &out.join(good)).is_ok(), "{good}");
        }
        for bad in [
            "up/a.csv",
            "up/out/a.csv",
            "inside/../up/a.csv",
            "dangling/a.csv",
        ] {
            let sentence = check_below(&out, &out.join(bad));
            // Through the link and back is out as well, as far as the first step goes.
            let sentence = sentence.unwrap_err().to_string();
            assert!(sentence.contains("is a link out of"), "{bad}: {sentence}");
        }
        assert!(check_below(&out, place.path()).is_err());
        assert!(check_below(&place.path().join("none"), &place.path().join("none/a")).is_ok());
    }

    #[test]
    fn a_file_is_whole_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_whole(&path, b"one").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one");
        assert!(write_whole(&folder.path().join("no/such/a.txt"), b"x").is_err());
        let staging = Staging::new(&folder.path().join("b.txt")).unwrap();
        fs::write(staging.path(), b"half").unwrap();
        drop(staging);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let staging = Staging::new(&folder.path().join("b.txt")).unwrap();
        fs::write(staging.path(), b"whole").unwrap();
        fs::write(staging.path().with_extension("yaml"), b"side").unwrap();
        let files = staging.publish().unwrap();
        assert!(files[0].ends_with("b.txt") && files.len() == 2);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
