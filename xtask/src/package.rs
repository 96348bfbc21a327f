//! `package`: the release bundle as one archive.

use std::process::Command;

use anyhow::Result;

use crate::args;
use crate::build;
use crate::files;
use crate::process::{phase, run as run_command, say};
use crate::workspace::{Profile, Workspace};

pub fn run(words: &[String]) -> Result<()> {
    args::none("package", words)?;
    let workspace = Workspace::load()?;
    phase("build", || build::compile(&workspace, Profile::Release))?;
    phase("bundle", || build::bundle(&workspace, Profile::Release))?;
    let folder = workspace.target.join("package");
    files::make_folder(&folder)?;
    let name = format!(
        "puncta-{}-{}-{}.tar.gz",
        workspace.version,
        std::env::consts::OS,
        std::env::consts::ARCH
    );
    let archive = folder.join(name);
    let bundle = workspace.bundle();
    // tar is part of Linux, macOS and Windows 10 and later; the file is complete only once it has its name.
    let part = archive.with_extension("part");
    run_command(
        Command::new("tar")
            .arg("-czf")
            .arg(&part)
            .arg("-C")
            .arg(&workspace.target)
            .arg(bundle.file_name().unwrap_or_default()),
    )?;
    std::fs::rename(&part, &archive)?;
    say(&format!("The package is {}", archive.display()));
    Ok(())
}
