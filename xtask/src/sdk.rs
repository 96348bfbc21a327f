//! The bundle's `sdk/`: the sources that a plugin author compiles against. Each package stands on its
//! own, so that a project can take copies of them and needs nothing else of this workspace.

use std::path::Path;

use anyhow::{Context, Result};
use toml::{Table, Value};

use crate::args::Usage;
use crate::files;
use crate::workspace::Workspace;

/// The folder of the SDK's packages.
const PACKAGES: &str = "plugin-api";
/// What packages inherit from the workspace.
const INHERITED: &str = "workspace";

pub fn run(words: &[String]) -> Result<()> {
    let [folder] = words else {
        return Err(Usage::error("'sdk' takes a folder".into()));
    };
    lay(&Workspace::load()?, Path::new(folder))
}

pub fn lay(workspace: &Workspace, to: &Path) -> Result<()> {
    let root = read(&workspace.root.join("Cargo.toml"))?;
    let packages = workspace.root.join(PACKAGES);
    let entries = std::fs::read_dir(&packages)
        .with_context(|| format!("cannot read {}", packages.display()))?;
    for entry in entries {
        let from = entry?.path();
        let name = from.file_name().unwrap_or_default().to_owned();
        let manifest = from.join("Cargo.toml");
        if !manifest.is_file() {
            continue;
        }
        let place = to.join(&name);
        files::copy_sources(&from, &place)?;
        // Examples are for this workspace's tests.
        files::remove_folder(&place.join("examples"))?;
        let text = toml::to_string(&own_manifest(&read(&manifest)?, &root)?)
            .context("cannot write a manifest of the SDK")?;
        let path = place.join("Cargo.toml");
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    files::copy_sources(&workspace.root.join("sdk-template"), &to.join("template"))?;
    files::copy(&workspace.root.join("Cargo.lock"), &to.join("Cargo.lock"))?;
    for licence in ["LICENSE-APACHE", "LICENSE-MIT"] {
        files::copy(&workspace.root.join(licence), &to.join(licence))?;
    }
    Ok(())
}

fn read(path: &Path) -> Result<Table> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    text.parse()
        .with_context(|| format!("cannot understand {}", path.display()))
}

/// A package's manifest with everything in it that it inherits from the workspace.
fn own_manifest(manifest: &Table, root: &Table) -> Result<Table> {
    let workspace = root
        .get("workspace")
        .and_then(Value::as_table)
        .context("the root Cargo.toml has no [workspace]")?;
    let shared = |table: &str, key: &str| -> Result<Value> {
        let found = workspace
            .get(table)
            .and_then(|table| table.get(key))
            .cloned();
        found.with_context(|| format!("the workspace has no {table}.{key}"))
    };
    let mut own = manifest.clone();
    // Lints are this workspace's policy; an author's compiler would only warn of them.
    own.remove("lints");
    own.remove("example");
    own.remove("dev-dependencies");
    if let Some(package) = own.get_mut("package").and_then(Value::as_table_mut) {
        for (key, value) in package.iter_mut() {
            if value.get(INHERITED).is_some() {
                *value = shared("package", key)?;
            }
        }
    }
    if let Some(dependencies) = own.get_mut("dependencies").and_then(Value::as_table_mut) {
        for (name, value) in dependencies.iter_mut() {
            if value.get(INHERITED).is_none() {
                continue;
            }
            let mut dependency = shared("dependencies", name)?;
            if let Some(path) = dependency.get_mut("path") {
                let folder = path.as_str().unwrap_or_default();
                let folder = folder.strip_prefix(PACKAGES).with_context(|| {
                    format!("{name} is not in {PACKAGES}, where the SDK's packages are")
                })?;
                *path = Value::String(format!("..{folder}"));
            }
            *value = dependency;
        }
    }
    Ok(own)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_stands_on_its_own() -> Result<()> {
        let root: Table = r#"
            [workspace.package]
            edition = "2024"
            version = "0.1.0"
            [workspace.dependencies]
            puncta-abi = { path = "plugin-api/abi" }
            puncta-engine = { path = "host/engine" }
            serde = { version = "1", features = ["derive"] }
        "#
        .parse()?;
        let package: Table = r#"
            [package]
            name = "puncta-sdk"
            version.workspace = true
            edition.workspace = true
            [dependencies]
            puncta-abi.workspace = true
            serde.workspace = true
            [lints]
            workspace = true
        "#
        .parse()?;
        let own = own_manifest(&package, &root)?;
        assert_eq!(own["package"]["edition"].as_str(), Some("2024"));
        assert_eq!(
            own["dependencies"]["puncta-abi"]["path"].as_str(),
            Some("../abi")
        );
        assert_eq!(own["dependencies"]["serde"]["version"].as_str(), Some("1"));
        assert!(!toml::to_string(&own)?.contains("workspace"));
        let stray: Table = "[dependencies]\npuncta-engine.workspace = true".parse()?;
        assert!(own_manifest(&stray, &root).is_err());
        Ok(())
    }
}
