//! `build`: compiles the workspace and lays the bundle, a folder that can be moved anywhere.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result};
use serde_json::{Map, Value, json};

use crate::args;
use crate::files::{self, Staged};
use crate::process::{output_of, phase, say};
use crate::sdk;
use crate::workspace::{Profile, Workspace};

pub fn run(words: &[String]) -> Result<()> {
    let profile = Profile::from_release(args::switch("build", "--release", words)?);
    let workspace = Workspace::load()?;
    phase("build", || compile(&workspace, profile))?;
    phase("bundle", || bundle(&workspace, profile))?;
    say(&format!(
        "The bundle is in {}",
        workspace.bundle().display()
    ));
    Ok(())
}

/// Compiles the whole workspace in one profile, so that every command shares what was compiled.
pub fn compile(workspace: &Workspace, profile: Profile) -> Result<()> {
    let mut cargo = workspace.compiler()?;
    cargo.args(["build", "--workspace", "--locked"]);
    if profile == Profile::Release {
        cargo.arg("--release");
    }
    crate::process::run(&mut cargo)
}

/// Writes the list of the bundle's libraries by hash: the program trusts those, and no others.
fn list(workspace: &Workspace, plugins: &Path) -> Result<()> {
    let mut libraries = Map::new();
    for plugin in &workspace.plugins {
        let place = plugins.join(&plugin.id);
        let path = place.join("plugin.json");
        let text =
            fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let packed: Value = serde_json::from_str(&text)
            .with_context(|| format!("cannot understand {}", path.display()))?;
        let hash = packed["hash"]
            .as_str()
            .with_context(|| format!("no hash in {}", path.display()))?;
        let size = fs::metadata(place.join(&plugin.library))?.len();
        let file = format!("{}/{}", plugin.id, plugin.library);
        libraries.insert(hash.to_owned(), json!({ "file": file, "size": size }));
    }
    let list = json!({ "format": "puncta.bundle/1", "libraries": libraries });
    let path = plugins.join("bundle.json");
    fs::write(&path, format!("{list:#}\n"))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Lays the bundle from what was compiled; the previous one stays until the new one is whole.
pub fn bundle(workspace: &Workspace, profile: Profile) -> Result<()> {
    let staged = Staged::new(&workspace.bundle())?;
    let built = workspace.program(profile, "puncta")?;
    let program = staged.path().join(built.file_name().unwrap_or_default());
    files::copy(&built, &program)?;
    for licence in ["LICENSE-APACHE", "LICENSE-MIT"] {
        files::copy(&workspace.root.join(licence), &staged.path().join(licence))?;
    }
    files::make_folder(&staged.path().join("plugins"))?;
    for plugin in &workspace.plugins {
        let library = staged
            .path()
            .join("plugins")
            .join(&plugin.id)
            .join(&plugin.library);
        files::copy(&workspace.built(profile, &plugin.library), &library)?;
        output_of(
            Command::new(&program)
                .args(["plugins", "pack"])
                .arg(&library),
        )?;
    }
    list(workspace, &staged.path().join("plugins"))?;
    sdk::lay(workspace, &staged.path().join("sdk"))?;
    staged.finish()
}
