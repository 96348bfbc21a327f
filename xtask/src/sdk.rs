//! The bundle's `sdk/`: the sources that a plugin author compiles against, as a workspace of its own.

use std::path::Path;

use anyhow::{Context, Result};
use toml::{Table, Value};

use crate::files;
use crate::workspace::Workspace;

/// The folder of the SDK's packages, here and in the bundle.
const PACKAGES: &str = "plugin-api";

pub fn lay(workspace: &Workspace, to: &Path) -> Result<()> {
    files::copy_sources(&workspace.root.join(PACKAGES), &to.join(PACKAGES))?;
    let template = workspace.root.join("sdk-template");
    if template.is_dir() {
        files::copy_sources(&template, &to.join("template"))?;
    }
    files::copy(&workspace.root.join("Cargo.lock"), &to.join("Cargo.lock"))?;
    let manifest = workspace.root.join("Cargo.toml");
    let text = std::fs::read_to_string(&manifest)
        .with_context(|| format!("cannot read {}", manifest.display()))?;
    std::fs::write(to.join("Cargo.toml"), own_manifest(&text)?)
        .with_context(|| format!("cannot write {}", to.join("Cargo.toml").display()))
}

/// The root manifest reduced to the SDK's packages: same versions and lints, other members.
fn own_manifest(text: &str) -> Result<String> {
    let mut manifest: Table = text.parse().context("cannot read the root Cargo.toml")?;
    let workspace = manifest
        .get_mut("workspace")
        .and_then(Value::as_table_mut)
        .context("the root Cargo.toml has no [workspace]")?;
    workspace.insert(
        "members".into(),
        Value::Array(vec![format!("{PACKAGES}/*").into()]),
    );
    workspace.insert("exclude".into(), Value::Array(vec!["template".into()]));
    workspace.remove("default-members");
    // Of our own packages the SDK holds only those in its folder.
    if let Some(dependencies) = workspace
        .get_mut("dependencies")
        .and_then(Value::as_table_mut)
    {
        dependencies.retain(|_, dependency| {
            dependency
                .get("path")
                .and_then(Value::as_str)
                .is_none_or(|path| path.starts_with(PACKAGES))
        });
    }
    // Profiles name packages that are not part of the SDK.
    manifest.remove("profile");
    toml::to_string(&manifest).context("cannot write the SDK's Cargo.toml")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manifest_keeps_versions_and_drops_the_host() -> Result<()> {
        let text = r#"
            [workspace]
            resolver = "3"
            members = ["host/*", "plugin-api/*", "xtask"]
            [workspace.package]
            edition = "2024"
            [workspace.dependencies]
            puncta-sdk = { path = "plugin-api/sdk" }
            puncta-engine = { path = "host/engine" }
            serde = { version = "1", features = ["derive"] }
            [profile.dev.package.rustfft]
            opt-level = 2
        "#;
        let manifest: Table = own_manifest(text)?.parse()?;
        let workspace = &manifest["workspace"];
        assert_eq!(
            workspace["members"],
            Value::Array(vec!["plugin-api/*".into()])
        );
        assert_eq!(workspace["package"]["edition"].as_str(), Some("2024"));
        assert_eq!(
            workspace["dependencies"]["serde"]["version"].as_str(),
            Some("1")
        );
        assert_eq!(
            workspace["dependencies"]["puncta-sdk"]["path"].as_str(),
            Some("plugin-api/sdk")
        );
        assert!(workspace["dependencies"].get("puncta-engine").is_none());
        assert!(!manifest.contains_key("profile"));
        Ok(())
    }
}
