//! Arrows between our crates run one way: app -> check -> engine -> abi; plugins -> sdk -> abi.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use cargo_metadata::MetadataCommand;
use std::collections::BTreeSet;

#[test]
fn no_crate_depends_on_what_it_may_not_know() {
    let metadata = MetadataCommand::new()
        .manifest_path(puncta_tests::root().join("Cargo.toml"))
        .other_options(vec!["--offline".into()])
        .exec()
        .expect("cargo metadata");
    let root = metadata.workspace_root.clone();
    let ours: BTreeSet<_> = metadata
        .workspace_packages()
        .iter()
        .map(|p| p.name.clone())
        .collect();
    let mut wrong = Vec::new();
    for package in metadata.workspace_packages() {
        let place = package
            .manifest_path
            .strip_prefix(&root)
            .expect("in the workspace");
        let place = place.parent().expect("a folder").as_str();
        for dependency in &package.dependencies {
            let known = ours.iter().any(|name| **name == *dependency.name);
            let test_only = dependency.kind == cargo_metadata::DependencyKind::Development;
            if known && !allowed(place, &dependency.name, test_only) {
                wrong.push(format!("{place} -> {}", dependency.name));
            }
        }
    }
    assert!(wrong.is_empty(), "forbidden arrows: {}", wrong.join(", "));
}

fn allowed(place: &str, dependency: &str, test_only: bool) -> bool {
    let any = |names: &[&str]| names.contains(&dependency);
    match place {
        "plugin-api/abi" | "plugin-api/documents" | "plugin-api/derive" | "xtask" => false,
        "plugin-api/door" => any(&["puncta-abi"]),
        "plugin-api/sdk" => any(&[
            "puncta-abi",
            "puncta-documents",
            "puncta-door",
            "puncta-derive",
        ]),
        "plugin-api/testkit" => any(&["puncta-sdk"]),
        "host/engine" => any(&["puncta-abi", "puncta-documents", "puncta-door"]),
        // The validator meets plugins by the bare tables, as a host of its own.
        "host/check" => any(&["puncta-engine", "puncta-abi", "puncta-door"]),
        "host/viewer" => any(&["puncta-engine"]),
        "host/app" => any(&["puncta-check", "puncta-engine", "puncta-viewer"]),
        _ if place.starts_with("plugins/") || place.starts_with("tests/plugins/") => {
            any(&["puncta-sdk"])
                || dependency.starts_with("puncta-shared-")
                || (test_only && any(&["puncta-testkit"]))
        }
        // Tests look at everything.
        _ => place.starts_with("tests"),
    }
}

#[test]
fn the_abi_has_no_dependencies() {
    let text = std::fs::read_to_string(puncta_tests::root().join("plugin-api/abi/Cargo.toml"));
    assert!(!text.unwrap().contains("dependencies"));
}

/// Files of test modules, by their names.
fn for_tests(path: &std::path::Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    stem.ends_with("tests") || stem == "mock" || stem == "random"
}

#[test]
fn the_host_names_no_operation_and_no_format() {
    let mut wrong = Vec::new();
    let words = [
        "puncta.filter",
        "puncta.render",
        "puncta.text",
        "puncta.hdf5",
        "thunderstorm",
        "picasso",
    ];
    let mut folders = vec![puncta_tests::root().join("host")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|suffix| suffix == "rs") && !for_tests(&path) {
                let text = std::fs::read_to_string(&path).unwrap();
                // Tests may use examples; what is compiled into the host may not.
                let code = text
                    .split("#[cfg(test)]")
                    .next()
                    .unwrap_or("")
                    .to_lowercase();
                let code: Vec<&str> = code
                    .lines()
                    .filter(|line| !line.trim_start().starts_with("//"))
                    .collect();
                let code = code.join("\n");
                wrong.extend(
                    words
                        .iter()
                        .filter(|word| code.contains(*word))
                        .map(|word| format!("{} in {}", word, path.display())),
                );
            }
        }
    }
    assert!(wrong.is_empty(), "the host names {}", wrong.join(", "));
}
