//! `test`: everything that must hold before a change lands.

use anyhow::Result;

use crate::args;
use crate::build;
use crate::process::{phase, probe, run as run_command, say};
use crate::workspace::{Profile, Workspace};

/// The selection that every compiling phase uses: another one would unify features otherwise and compile again.
const SELECTION: [&str; 2] = ["--workspace", "--locked"];

pub fn run(words: &[String]) -> Result<()> {
    let all = args::switch("test", "--all", words)?;
    let workspace = Workspace::load()?;
    phase("formatting", || {
        run_command(workspace.cargo().args(["fmt", "--all", "--check"]))
    })?;
    check_dependencies(&workspace)?;
    phase("lints", || {
        let mut cargo = workspace.compiler()?;
        run_command(cargo.arg("clippy").args(SELECTION).args([
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ]))
    })?;
    phase("build", || build::compile(&workspace, Profile::Dev))?;
    phase("bundle", || build::bundle(&workspace, Profile::Dev))?;
    phase("examples in the documentation", || {
        let mut cargo = workspace.compiler()?;
        run_command(cargo.args(["test", "--doc", "--quiet"]).args(SELECTION))
    })?;
    tests(&workspace, all)
}

/// The runner's closing lines are the last that is printed, so this is no `phase`.
fn tests(workspace: &Workspace, all: bool) -> Result<()> {
    let nextest = probe(workspace.cargo().args(["nextest", "--version"])).is_some();
    say(if all {
        "== tests, with the slow ones"
    } else {
        "== tests"
    });
    let mut runner = workspace.compiler()?;
    if nextest {
        runner.args(["nextest", "run"]).args(SELECTION);
    } else {
        runner.args(["test", "--tests"]).args(SELECTION);
    }
    if all {
        runner.env("PUNCTA_TEST_ALL", "1");
    }
    run_command(&mut runner)
}

/// Licences and sources, where cargo-deny is installed. Advisories are left to a person (`cargo deny check`): a
/// notice published elsewhere must not change whether the tests of an unchanged workspace pass.
fn check_dependencies(workspace: &Workspace) -> Result<()> {
    if probe(workspace.cargo().args(["deny", "--version"])).is_none() {
        say("== dependencies: not checked, cargo-deny is not installed");
        return Ok(());
    }
    phase("dependencies", || {
        run_command(
            workspace
                .cargo()
                .args(["deny", "check", "licenses", "bans", "sources"]),
        )
    })
}
