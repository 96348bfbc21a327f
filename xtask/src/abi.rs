//! `abi`: rewrites the snapshot of the plugin ABI and the C header from the Rust tables, and shows what changed.

use std::process::Command;

use anyhow::Result;

use crate::args;
use crate::process::{phase, run as run_command};
use crate::workspace::Workspace;

/// The test that compares the snapshot writes it instead when this is set.
const WRITE: &str = "PUNCTA_ABI_WRITE";

pub fn run(words: &[String]) -> Result<()> {
    args::none("abi", words)?;
    let workspace = Workspace::load()?;
    phase("snapshot", || {
        let mut cargo = workspace.compiler()?;
        run_command(cargo.env(WRITE, "1").args([
            "test",
            "--locked",
            "--package",
            "puncta-tests",
            "abi",
        ]))
    })?;
    run_command(Command::new("git").current_dir(&workspace.root).args([
        "--no-pager",
        "diff",
        "--stat",
        "--patch",
        "--",
        "plugin-api",
        "tests",
        "docs",
    ]))
}
