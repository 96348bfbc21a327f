//! `bench`: the benchmarks, in release mode.

use std::process::Command;

use anyhow::Result;

use crate::build;
use crate::process::{phase, run as run_command};
use crate::workspace::{Profile, Workspace};

/// All arguments (such as `--compare`) go to the benchmark program.
pub fn run(words: &[String]) -> Result<()> {
    let workspace = Workspace::load()?;
    phase("build", || build::compile(&workspace, Profile::Release))?;
    let program = workspace.program(Profile::Release, "puncta-bench")?;
    run_command(
        Command::new(program)
            .current_dir(&workspace.root)
            .args(words),
    )
}
