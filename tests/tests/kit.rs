//! The author's kit: projects that `puncta plugins new` makes build, pass their tests and the
//! validator, and work in the host, without the bundle that they came from.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{Bundle, build_folder, product, root};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// A bundle with an SDK.
fn bundle() -> Bundle {
    let bundle = Bundle::of(&["puncta_plugin_text", "puncta_plugin_synthetic"]);
    let mut lay = Command::new(product("xtask"));
    lay.arg("sdk")
        .arg(bundle.path().join("sdk"))
        .current_dir(root());
    done(&mut lay);
    bundle
}

fn done(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = text(&output.stderr);
    assert!(
        output.status.success(),
        "{command:?}: {said}{}",
        text(&output.stdout)
    );
    text(&output.stdout)
}

/// A project, and cargo in it.
struct Project {
    folder: PathBuf,
    target: PathBuf,
}

impl Project {
    fn cargo(&self, arguments: &[&str]) {
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.args(arguments).current_dir(&self.folder);
        // Nothing of this test's own build may reach it.
        for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "RUSTC_WRAPPER"] {
            cargo.env_remove(name);
        }
        done(cargo.env("CARGO_TARGET_DIR", &self.target));
    }

    fn library(&self, name: &str) -> PathBuf {
        self.target.join("debug").join(format!("lib{name}.so"))
    }
}

fn new(bundle: &Bundle, place: &Path, name: &str, more: &[&str]) -> PathBuf {
    let mut command = bundle.command();
    command
        .args(["plugins", "new", name])
        .args(more)
        .current_dir(place);
    done(&mut command);
    place.join(name)
}

fn no_path_of(project: &Path, bundle: &Path) {
    let shown = bundle.display().to_string();
    let mut folders = vec![project.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder)
            .unwrap()
            .flatten()
            .map(|entry| entry.path())
        {
            if path.is_dir() {
                folders.push(path);
            } else {
                let text = fs::read_to_string(&path).unwrap_or_default();
                assert!(
                    !text.contains(&shown),
                    "{} names the bundle",
                    path.display()
                );
                assert!(!text.contains("my-plugin"), "{} is unnamed", path.display());
            }
        }
    }
}

/// The validator's verdict on a library.
fn valid(bundle: &Bundle, library: &Path) {
    let mut check = bundle.command();
    done(
        check
            .args(["plugins", "check", "--strictness", "10"])
            .arg(library),
    );
}

#[test]
fn projects_in_rust_build_without_their_bundle() {
    let (bundle, place) = (bundle(), tempfile::tempdir().unwrap());
    let away = bundle.path().join("sdk-moved-away");
    for kind in ["operation", "reader", "writer"] {
        let name = format!("new-{kind}");
        let folder = new(&bundle, place.path(), &name, &["--kind", kind]);
        no_path_of(&folder, bundle.path());
        fs::rename(bundle.path().join("sdk"), &away).unwrap();
        let target = build_folder().join("kit-target");
        let project = Project { folder, target };
        project.cargo(&["build", "--offline"]);
        project.cargo(&["test", "--offline"]);
        project.cargo(&["fmt", "--check"]);
        project.cargo(&[
            "clippy",
            "--offline",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ]);
        fs::rename(&away, bundle.path().join("sdk")).unwrap();
        valid(&bundle, &project.library(&name.replace('-', "_")));
    }
    let code = fs::read_to_string(place.path().join("new-operation/src/lib.rs")).unwrap();
    let written = code.lines().map(str::trim);
    let written = written.filter(|line| !line.is_empty() && !line.starts_with("//"));
    assert!(written.count() <= 40, "an author writes more than 40 lines");
}

#[test]
fn projects_in_c_need_a_compiler_only() {
    let (bundle, place) = (bundle(), tempfile::tempdir().unwrap());
    for kind in ["operation", "reader", "writer"] {
        let name = format!("c-{kind}");
        let folder = new(
            &bundle,
            place.path(),
            &name,
            &["--kind", kind, "--language", "c"],
        );
        no_path_of(&folder, bundle.path());
        done(Command::new("make").current_dir(&folder));
        done(Command::new("make").arg("test").current_dir(&folder));
        let library = format!("build/lib{}.so", name.replace('-', "_"));
        valid(&bundle, &folder.join(library));
    }
}

#[test]
fn the_sdk_of_a_project_is_replaced_as_a_whole() {
    let (bundle, place) = (bundle(), tempfile::tempdir().unwrap());
    let project = new(&bundle, place.path(), "aging", &[]);
    let stale = project.join("puncta-sdk/sdk/src/stale.rs");
    fs::write(&stale, "old").unwrap();
    fs::write(project.join("src/own.rs"), "mine").unwrap();
    let mut update = bundle.command();
    done(update.args(["plugins", "update-sdk"]).arg(&project));
    assert!(!stale.exists() && project.join("puncta-sdk/sdk/src/lib.rs").is_file());
    assert!(project.join("src/own.rs").is_file() && !project.join("puncta-sdk.old").exists());
    for wrong in [
        &["new", "aging"][..],
        &["new", "Wrong Name"],
        &["update-sdk", "/tmp"],
    ] {
        let mut command = bundle.command();
        command.arg("plugins").args(wrong).current_dir(place.path());
        let output = command.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && said.trim().lines().count() == 1,
            "{said}"
        );
    }
}

/// What an author writes: the distance of each localisation to the nearest other one.
const NEAREST: &str = r#"//! Distances to nearest neighbours.

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

plugin! { id: "lab.nearest", title: "Nearest", description: "Neighbours.", reentrant: true }

/// Adds the distance of each localisation to the nearest other one.
#[derive(Params)]
pub struct Nearest {
    /// Neighbours that are farther away do not count.
    #[param(default = 1000.0, unit = "nm", min = 0.001)]
    reach: f64,
}

impl Operation for Nearest {
    const ID: &'static str = "lab.nearest.distance/1";

    fn info() -> Info {
        Info::operation("Nearest neighbours")
            .description("Adds a column nn with the distance to the nearest other localisation.")
            .input(Ports::table("table").column("x", "nm").column("y", "nm"))
            .output(Ports::columns("table", "table"))
            .example(json!({"reach": 500}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let mut out = job.add_columns("table", [ColumnInfo::new("nn", Element::F64, "nm")])?;
        for (i, nn) in out.f64_mut("nn")?.iter_mut().enumerate() {
            if i % 100 == 0 { job.progress(i as f64 / x.len() as f64, "neighbours")?; }
            let others = (0..x.len()).filter(|j| *j != i);
            let far = others.map(|j| (x[i] - x[j]).hypot(y[i] - y[j]));
            *nn = far.filter(|d| *d <= self.reach).fold(f64::INFINITY, f64::min);
        }
        out.finish()
    }
}
register!(Nearest);
"#;

/// From the bundle alone to a number: below 3 minutes on two cores with a warm registry cache.
#[test]
fn an_idea_becomes_a_number_in_minutes() {
    if std::env::var_os("PUNCTA_TEST_ALL").is_none() {
        return;
    }
    let (bundle, place) = (bundle(), tempfile::tempdir().unwrap());
    let begin = Instant::now();
    let folder = new(&bundle, place.path(), "nearest", &[]);
    fs::write(folder.join("src/lib.rs"), NEAREST).unwrap();
    fs::remove_dir_all(folder.join("tests")).unwrap();
    let target = folder.join("target");
    let project = Project { folder, target };
    project.cargo(&["build", "--offline"]);
    let library = project.library("nearest");
    // A right triangle and a point: 3, 3, 4, and 10 from the corner (3, 0).
    fs::write(
        place.path().join("in.csv"),
        "x [nm],y [nm]\n0,0\n3,0\n0,4\n13,0\n",
    )
    .unwrap();
    let run = |arguments: &[&str]| {
        let mut command = bundle.command();
        command.arg("--plugins").arg(library.parent().unwrap());
        done(command.args(arguments).current_dir(place.path()))
    };
    run(&["plugins", "trust", library.to_str().unwrap()]);
    run(&["op", "lab.nearest.distance", "in.csv", "-o", "out.csv"]);
    let time = begin.elapsed();
    let text = fs::read_to_string(place.path().join("out.csv")).unwrap();
    let last = |line: &str| line.rsplit(',').next().unwrap().parse::<f64>().unwrap();
    let distances: Vec<f64> = text.lines().skip(1).map(last).collect();
    assert_eq!(distances, [3.0, 3.0, 4.0, 10.0], "{text}");
    assert!(time < Duration::from_secs(180), "it took {time:?}");
    valid(&bundle, &library);
}
