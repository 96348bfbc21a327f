//! What the whole-product tests share: where the build's products lie, and bundles of plugins.
#![allow(clippy::expect_used, clippy::unwrap_used, clippy::missing_panics_doc)]

pub mod c;
pub mod faults;
pub mod lab;
pub mod left;

use puncta_engine::engine::Options;
use puncta_engine::plugins::catalogue::{self, Folder};
use puncta_engine::worker::{Pool, Start};
use puncta_engine::{Engine, Isolation, Progress, Unwatched};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// Folder of the build's products, such as `target/debug`.
#[must_use]
pub fn build_folder() -> PathBuf {
    let program = std::env::current_exe().expect("the test's own path");
    // A test lies in <build>/deps, an example or binary in <build>.
    let folder = program.parent().expect("a folder");
    if folder.ends_with("deps") {
        folder.parent().expect("a folder")
    } else {
        folder
    }
    .into()
}

/// Root of the workspace.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the workspace")
        .into()
}

/// A product of the build.
#[must_use]
pub fn product(name: &str) -> PathBuf {
    let path = build_folder().join(name);
    assert!(
        path.exists(),
        "{} is missing: run cargo build --workspace first",
        path.display()
    );
    path
}

/// The `puncta` binary.
#[must_use]
pub fn program() -> PathBuf {
    product(&format!("puncta{}", std::env::consts::EXE_SUFFIX))
}

/// The library of a package, such as `puncta_plugin_filter`.
#[must_use]
pub fn library(package: &str) -> PathBuf {
    use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
    product(&format!("{DLL_PREFIX}{package}{DLL_SUFFIX}"))
}

/// The real data beside the workspace, if they are there.
#[must_use]
pub fn shared_data() -> Option<PathBuf> {
    let folder = root().parent()?.join("shared").join("data");
    folder.is_dir().then_some(folder)
}

/// The lists of expected values name their files by SHA-256, which the system's own program computes.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    use std::io::Write;
    use std::process::Stdio;
    let mut child = Command::new("sha256sum")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("sha256sum is installed");
    child.stdin.take().unwrap().write_all(bytes).unwrap();
    let output = child.wait_with_output().unwrap();
    String::from_utf8_lossy(&output.stdout)
        .split_whitespace()
        .next()
        .unwrap_or("")
        .to_owned()
}

/// A bundle as `cargo xtask build` lays it: the program, and plugins packed from libraries of the
/// build, which the bundle lists. It has a configuration folder of its own, empty at first.
pub struct Bundle {
    folder: tempfile::TempDir,
}

impl Bundle {
    /// Packs these packages' libraries.
    #[must_use]
    pub fn of(packages: &[&str]) -> Bundle {
        // Beside the build's products, so that libraries can be linked instead of copied.
        let place = build_folder().join("test-bundles");
        std::fs::create_dir_all(&place).expect("a folder");
        let folder = tempfile::tempdir_in(place).expect("a temporary folder");
        let workers = Arc::new(Pool::new(Start::new(program())));
        let mut listed = serde_json::Map::new();
        for package in packages {
            let library = library(package);
            let place = folder.path().join("plugins").join(package);
            std::fs::create_dir_all(&place).expect("a folder");
            let copy = place.join(library.file_name().expect("a name"));
            if std::fs::hard_link(&library, &copy).is_err() {
                std::fs::copy(&library, &copy).expect("a copy");
            }
            let (_, packed) =
                catalogue::pack(&copy, &workers).expect("the plugin describes itself");
            let size = copy.metadata().expect("the library").len();
            let file = format!("{package}/{}", packed.library);
            listed.insert(packed.hash, json!({ "file": file, "size": size }));
        }
        let plugins = folder.path().join("plugins");
        std::fs::create_dir_all(&plugins).expect("a folder");
        let list = json!({ "format": "puncta.bundle/1", "libraries": listed });
        std::fs::write(plugins.join("bundle.json"), list.to_string()).expect("a file");
        let bundle = Bundle { folder };
        if std::fs::hard_link(program(), bundle.program()).is_err() {
            std::fs::copy(program(), bundle.program()).expect("a copy");
        }
        bundle
    }

    /// The program in the bundle, which trusts the bundle's plugins.
    #[must_use]
    pub fn program(&self) -> PathBuf {
        let name = format!("puncta{}", std::env::consts::EXE_SUFFIX);
        self.path().join(name)
    }

    /// The bundle's configuration folder.
    #[must_use]
    pub fn config(&self) -> PathBuf {
        self.path().join("config")
    }

    /// The program in the bundle, with the bundle's configuration folder and no other plugins.
    #[must_use]
    pub fn command(&self) -> Command {
        let mut command = Command::new(self.program());
        command
            .env("PUNCTA_CONFIG", self.config())
            .env("PUNCTA_CACHE", build_folder().join("puncta-test-cache"))
            // Tests compute.
            .env("PUNCTA_RESULTS", "0")
            .env_remove("PUNCTA_STATE")
            .env_remove("PUNCTA_PLUGIN_PATH");
        command
    }

    /// Where it lies.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Options of an engine with this bundle only.
    #[must_use]
    pub fn options(&self) -> Options {
        Options {
            folders: vec![Folder {
                path: self.path().join("plugins"),
                bundled: true,
            }],
            cache: build_folder().join("puncta-test-cache"),
            config: Some(self.config()),
            state: Some(self.config().join("state")),
            program: program(),
            threads: 2,
            isolation: Isolation::ByPlugin,
            memory: 8 << 30,
            worker_memory: 4 << 30,
            // Tests compute.
            results: 0,
        }
    }

    /// An engine with this bundle only.
    #[must_use]
    pub fn engine(&self, isolation: Isolation) -> Engine {
        Engine::open(Options {
            isolation,
            ..self.options()
        })
        .expect("an engine")
    }
}

/// Work that nobody watches.
#[must_use]
pub fn unwatched() -> Arc<dyn Progress> {
    Arc::new(Unwatched)
}

/// Hash of the headers and of every byte of every column.
#[must_use]
pub fn fingerprint(outputs: &[(String, puncta_engine::Object)]) -> String {
    let mut hasher = blake3::Hasher::new();
    for (port, object) in outputs {
        hasher.update(port.as_bytes());
        hasher.update(&serde_json::to_vec(object.header()).expect("JSON"));
        for part in 0..object.header().parts.len() {
            for stored in object.columns(part) {
                let column = stored.column().expect("the column");
                for region in [&column.data, &column.offsets, &column.text]
                    .into_iter()
                    .flatten()
                {
                    hasher.update(region.slice::<u8>());
                }
            }
        }
    }
    hasher.finalize().to_string()
}
