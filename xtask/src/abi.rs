//! `abi`: rewrites the snapshot of the plugin ABI and the C header from the Rust tables, and says what changed.

use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::args;
use crate::layout::{Layout, difference};
use crate::process::{phase, run as run_command, say};
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
            "--test",
            "abi",
            "header_and_layout_are_committed",
        ]))
    })?;
    run_command(Command::new("git").current_dir(&workspace.root).args([
        "--no-pager",
        "diff",
        "--stat",
        "--patch",
        "--",
        "plugin-api",
        "docs",
    ]))?;
    explain(&workspace)
}

/// Says what the layout means for plugins that were built before; an error if they would break.
fn explain(workspace: &Workspace) -> Result<()> {
    let path = workspace.root.join("plugin-api/abi/layout.txt");
    let read = |path: &std::path::Path| {
        std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
    };
    let now = Layout::read(&read(&path)?);
    let fossil = workspace
        .root
        .join(format!("tests/fossils/v0_{}/layout.txt", now.number));
    if !fossil.is_file() {
        bail!(
            "ABI number {} has no fossil: copy puncta.h, layout.txt and a plugin into {}, and add a row to docs/abi.md",
            now.number,
            fossil.parent().unwrap_or(&fossil).display()
        );
    }
    let found = difference(&Layout::read(&read(&fossil)?), &now);
    for sentence in &found.added {
        say(&format!(
            "{sentence}: plugins that do not know it are not disturbed"
        ));
    }
    for sentence in &found.broken {
        say(&format!(
            "{sentence}: a plugin built before would use the wrong bytes"
        ));
    }
    if !found.broken.is_empty() {
        bail!(
            "the layout of ABI number {} changed; undo that, add a new table instead, or bump ABI_NUMBER as docs/abi.md says",
            now.number
        );
    }
    say(&format!(
        "plugins of ABI number {} load in this host",
        now.number
    ));
    Ok(())
}
