//! `demo`: from a simulated data set to a rendered image, with nothing but the bundle.

use std::path::Path;
use std::process::Command;

use anyhow::{Result, bail};

use crate::args;
use crate::build;
use crate::files;
use crate::process::{phase, run as run_command, say};
use crate::workspace::{Profile, Workspace};

/// What the recipe writes, and what it is.
const RESULTS: [(&str, &str); 3] = [
    ("er.tif", "the rendered image (32-bit TIFF)"),
    ("er.png", "the same as a picture"),
    ("er-filtered.csv", "the filtered table"),
];

pub fn run(words: &[String]) -> Result<()> {
    let profile = Profile::from_release(args::switch("demo", "--release", words)?);
    let workspace = Workspace::load()?;
    if !workspace.puncta().is_file() {
        say("The first build compiles every dependency: about 6 to 10 minutes on two cores.");
    }
    phase("build", || build::compile(&workspace, profile))?;
    phase("bundle", || build::bundle(&workspace, profile))?;
    let folder = workspace.target.join("demo");
    files::remove_folder(&folder)?;
    files::make_folder(&folder)?;
    let table = folder.join("er.csv");
    phase("simulate", || simulate(&workspace, &table))?;
    phase("recipe", || recipe(&workspace, &table, &folder))?;
    for (file, what) in RESULTS {
        let path = folder.join(file);
        if !path.is_file() {
            bail!("the recipe wrote no {}", path.display());
        }
        say(&format!("{}  {what}", path.display()));
    }
    Ok(())
}

fn simulate(workspace: &Workspace, table: &Path) -> Result<()> {
    run_command(
        Command::new(workspace.puncta())
            .args([
                "op",
                "puncta.synthetic.membrane/1",
                "--shape",
                "er",
                "--copies",
                "64",
                "--turn",
                "about_z",
                "--acceptance",
                "0.02",
                "--seed",
                "1",
                "-o",
            ])
            .arg(table),
    )
}

fn recipe(workspace: &Workspace, table: &Path, out: &Path) -> Result<()> {
    run_command(
        Command::new(workspace.puncta())
            .arg("run")
            .arg(
                workspace
                    .root
                    .join("docs")
                    .join("recipes")
                    .join("demo.toml"),
            )
            .arg("--input")
            .arg(format!("locs={}", table.display()))
            .arg("--out")
            .arg(out),
    )
}
