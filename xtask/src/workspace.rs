//! What cargo says of the workspace: its folders and the plugins in it.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX, EXE_SUFFIX};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::process::output_of;
use crate::tools;

/// How the workspace is compiled.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    Dev,
    Release,
}

impl Profile {
    pub fn from_release(release: bool) -> Self {
        if release { Self::Release } else { Self::Dev }
    }

    /// The folder below the target folder that holds what was built.
    fn folder(self) -> &'static str {
        match self {
            Self::Dev => "debug",
            Self::Release => "release",
        }
    }
}

/// A workspace package that builds a plugin library.
#[derive(Debug, PartialEq, Eq)]
pub struct Plugin {
    /// The folder's name below `plugins/`, which is also its folder in the bundle.
    pub id: String,
    /// The library's file name on this platform.
    pub library: String,
}

/// The workspace as `cargo metadata` describes it.
pub struct Workspace {
    pub root: PathBuf,
    /// Cargo's target folder.
    pub target: PathBuf,
    /// The version of the `puncta` program.
    pub version: String,
    /// Sorted by id.
    pub plugins: Vec<Plugin>,
}

impl Workspace {
    pub fn load() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"))
            .parent()
            .context("the xtask package is not inside the workspace")?;
        let text = output_of(cargo(root).args([
            "metadata",
            "--format-version=1",
            "--no-deps",
            "--locked",
        ]))?;
        let metadata =
            serde_json::from_str(&text).context("cannot read what cargo metadata says")?;
        Self::from_metadata(&metadata)
    }

    fn from_metadata(metadata: &Value) -> Result<Self> {
        let path = |key: &str| -> Result<PathBuf> {
            let text = metadata[key]
                .as_str()
                .with_context(|| format!("no '{key}' in cargo metadata"))?;
            Ok(PathBuf::from(text))
        };
        let root = path("workspace_root")?;
        let packages = metadata["packages"]
            .as_array()
            .context("no packages in cargo metadata")?;
        let mut plugins: Vec<Plugin> = packages
            .iter()
            .filter_map(|package| plugin(&root, package))
            .collect();
        plugins.sort_by(|a, b| a.id.cmp(&b.id));
        let version = packages
            .iter()
            .find(|package| builds(package, "bin", "puncta"))
            .and_then(|package| package["version"].as_str())
            .context("no workspace package builds the program 'puncta'")?
            .to_string();
        Ok(Self {
            target: path("target_directory")?,
            root,
            version,
            plugins,
        })
    }

    /// Cargo in the root of the workspace, for what compiles nothing.
    pub fn cargo(&self) -> Command {
        cargo(&self.root)
    }

    /// Cargo with CMake set up for the packages that compile C libraries.
    pub fn compiler(&self) -> Result<Command> {
        let mut command = cargo(&self.root);
        tools::set_cmake(&mut command, &self.target)?;
        Ok(command)
    }

    /// A file that the workspace built.
    pub fn built(&self, profile: Profile, file: &str) -> PathBuf {
        self.target.join(profile.folder()).join(file)
    }

    /// A program that the workspace built; an error when it is not there.
    pub fn program(&self, profile: Profile, name: &str) -> Result<PathBuf> {
        let path = self.built(profile, &format!("{name}{EXE_SUFFIX}"));
        if !path.is_file() {
            bail!("the build left no program {}", path.display());
        }
        Ok(path)
    }

    /// The bundle that `build` lays.
    pub fn bundle(&self) -> PathBuf {
        self.target.join("puncta")
    }

    /// The `puncta` program of the bundle.
    pub fn puncta(&self) -> PathBuf {
        self.bundle().join(format!("puncta{EXE_SUFFIX}"))
    }
}

fn cargo(root: &Path) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root);
    command
}

/// Whether the package has a target of this kind and name.
fn builds(package: &Value, kind: &str, name: &str) -> bool {
    targets(package, kind).any(|target| target["name"] == name)
}

fn targets<'a>(package: &'a Value, kind: &'a str) -> impl Iterator<Item = &'a Value> {
    package["targets"]
        .as_array()
        .into_iter()
        .flatten()
        .filter(move |target| {
            target["kind"]
                .as_array()
                .is_some_and(|kinds| kinds.iter().any(|k| k == kind))
        })
}

/// The plugin that a package builds: it lies below `plugins/` but not in `plugins/shared/`, and has a cdylib target.
fn plugin(root: &Path, package: &Value) -> Option<Plugin> {
    let manifest = Path::new(package["manifest_path"].as_str()?);
    let folder = manifest.parent()?.strip_prefix(root.join("plugins")).ok()?;
    if folder.starts_with("shared") {
        return None;
    }
    let id = folder.file_name()?.to_str()?.to_string();
    let name = targets(package, "cdylib").next()?["name"]
        .as_str()?
        .replace('-', "_");
    Some(Plugin {
        id,
        library: format!("{DLL_PREFIX}{name}{DLL_SUFFIX}"),
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn package(folder: &str, name: &str, kinds: &[&str]) -> Value {
        json!({
            "name": name, "version": "1.2.3", "manifest_path": format!("/w/{folder}/Cargo.toml"),
            "targets": [{ "name": name, "kind": kinds }],
        })
    }

    #[test]
    fn plugins_are_the_cdylibs_below_plugins() -> Result<()> {
        let metadata = json!({
            "workspace_root": "/w", "target_directory": "/w/target",
            "packages": [
                package("host/app", "puncta", &["bin"]),
                package("plugins/render", "puncta-render", &["cdylib", "rlib"]),
                package("plugins/filter", "puncta-filter", &["cdylib"]),
                package("plugins/shared/geometry", "puncta-geometry", &["cdylib"]),
                package("plugins/notes", "notes", &["lib"]),
                package("tests/plugins/faulty", "faulty", &["cdylib"]),
            ],
        });
        let workspace = Workspace::from_metadata(&metadata)?;
        let found: Vec<_> = workspace
            .plugins
            .iter()
            .map(|p| (p.id.as_str(), p.library.as_str()))
            .collect();
        let render = format!("{DLL_PREFIX}puncta_render{DLL_SUFFIX}");
        let filter = format!("{DLL_PREFIX}puncta_filter{DLL_SUFFIX}");
        assert_eq!(
            found,
            [("filter", filter.as_str()), ("render", render.as_str())]
        );
        assert_eq!(workspace.version, "1.2.3");
        assert_eq!(workspace.bundle(), Path::new("/w/target/puncta"));
        Ok(())
    }

    #[test]
    fn a_workspace_without_the_program_is_refused() {
        let metadata = json!({ "workspace_root": "/w", "target_directory": "/t", "packages": [] });
        assert!(Workspace::from_metadata(&metadata).is_err());
    }
}
