//! CMake, which the bundled C libraries (HDF5) are built with.

use std::env::consts::EXE_SUFFIX;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, anyhow};

use crate::process::{probe, run, say};

/// The oldest CMake that HDF5 accepts.
const OLDEST: (u32, u32) = (3, 26);

/// Sets CMAKE for cargo's build scripts, unless the `cmake` that they would find by themselves is new enough.
pub fn set_cmake(command: &mut Command, target: &Path) -> Result<()> {
    match std::env::var_os("CMAKE").filter(|chosen| !chosen.is_empty()) {
        Some(chosen) => require(chosen),
        None if suits(Path::new("cmake")) => Ok(()),
        None => {
            command.env("CMAKE", own(&target.join("tools").join("cmake"))?);
            Ok(())
        }
    }
}

/// The person's own choice is used as it is, or refused.
fn require(chosen: OsString) -> Result<()> {
    if suits(Path::new(&chosen)) {
        return Ok(());
    }
    Err(anyhow!(
        "the environment's CMAKE ({}) is not CMake {}.{} or newer: unset it or install a newer one",
        chosen.to_string_lossy(),
        OLDEST.0,
        OLDEST.1
    ))
}

/// A CMake of our own in a Python environment below the target folder, made when it is not there yet.
fn own(folder: &Path) -> Result<PathBuf> {
    let scripts = folder.join(if cfg!(windows) { "Scripts" } else { "bin" });
    let cmake = scripts.join(format!("cmake{EXE_SUFFIX}"));
    if suits(&cmake) {
        return Ok(cmake);
    }
    say(&format!(
        "There is no CMake {}.{} here: installing one with pip.",
        OLDEST.0, OLDEST.1
    ));
    let python = ["python3", "python"]
        .into_iter()
        .find(|name| probe(Command::new(name).arg("--version")).is_some())
        .ok_or_else(|| advice("there is no Python"))?;
    run(Command::new(python)
        .args(["-m", "venv", "--clear"])
        .arg(folder))
    .map_err(|error| advice(&error.to_string()))?;
    run(
        Command::new(scripts.join(format!("python{EXE_SUFFIX}"))).args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "cmake>=3.26,<5",
        ]),
    )
    .map_err(|error| advice(&error.to_string()))?;
    if suits(&cmake) {
        Ok(cmake)
    } else {
        Err(advice("the one that pip installed does not run"))
    }
}

fn advice(why: &str) -> anyhow::Error {
    anyhow!(
        "CMake {}.{} or newer is needed and could not be installed ({why}): install CMake, or Python 3 with venv and pip",
        OLDEST.0,
        OLDEST.1
    )
}

/// Whether this program is a CMake that is new enough.
fn suits(program: &Path) -> bool {
    probe(Command::new(program).arg("--version"))
        .and_then(|text| version(&text))
        .is_some_and(|found| found >= OLDEST)
}

/// Major and minor number from the first line, "cmake version 3.25.1".
fn version(text: &str) -> Option<(u32, u32)> {
    let number = text.lines().next()?.strip_prefix("cmake version ")?;
    let mut parts = number.split('.');
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_compare_by_number() {
        let new_enough = |text| version(text).is_some_and(|found| found >= OLDEST);
        assert!(!new_enough("cmake version 3.25.1\n\nCMake suite"));
        assert!(new_enough("cmake version 3.26.0-rc1"));
        assert!(new_enough("cmake version 4.0.3"));
        assert!(!new_enough("cmake 4.0.3"));
        assert!(!new_enough(""));
    }

    #[test]
    fn a_program_that_is_no_cmake_does_not_suit() {
        assert!(!suits(Path::new("no-such-program-on-any-machine")));
    }
}
