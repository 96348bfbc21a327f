//! What recipes and documents may not do.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::lab::{Lab, all_in};
use std::fs;
use std::path::Path;

#[test]
fn a_recipe_writes_below_its_output_folder_only() {
    use std::os::unix::fs::symlink;
    let lab = Lab::plain();
    let place = lab.folder.path();
    let (out, outside) = (place.join("out"), place.join("outside"));
    fs::create_dir_all(&out).unwrap();
    fs::create_dir_all(&outside).unwrap();
    symlink(&outside, out.join("link")).unwrap();
    fs::write(place.join("secret.csv"), "secret").unwrap();
    symlink(place.join("secret.csv"), out.join("file.csv")).unwrap();
    let recipe = |file: &str| {
        let text = format!(
            "format = \"puncta.recipe/1\"\n[steps.p]\nop = \"test.points/1\"\n\
             [outputs]\n\"{file}\" = \"p\"\n"
        );
        lab.write("r.toml", &text);
        ["run", "r.toml", "--out", "out", "--overwrite"]
    };
    for (file, word) in [
        ("link/a.csv", "is a link out of the output folder"),
        ("link/deep/a.csv", "is a link out of the output folder"),
        ("../a.csv", "leaves the output folder"),
        ("x/../../a.csv", "leaves the output folder"),
        ("/tmp/puncta-a.csv", "absolute"),
    ] {
        all_in(&lab.refused(&recipe(file)), &[word]);
    }
    assert_eq!(fs::read_dir(&outside).unwrap().count(), 0);
    assert!(!place.join("a.csv").exists() && !Path::new("/tmp/puncta-a.csv").exists());
    // A link in the place of a file is replaced, and what it leads to stays.
    lab.good(&recipe("file.csv"));
    assert_eq!(
        fs::read_to_string(place.join("secret.csv")).unwrap(),
        "secret"
    );
    assert!(!out.join("file.csv").is_symlink());
}

#[test]
fn documents_that_are_too_large_or_deep_are_named() {
    let lab = Lab::plain();
    let large = fs::File::create(lab.folder.path().join("r.toml")).unwrap();
    large.set_len(3 << 30).unwrap();
    let sentence = lab.refused(&["run", "r.toml"]);
    all_in(
        &sentence,
        &["r.toml is no recipe, since it is larger than 16 MB"],
    );
    let nested = format!(
        "format = \"puncta.recipe/1\"\n[steps.p]\nop = \"test.points/1\"\nset.rows = {}{}\n",
        "[".repeat(100_000),
        "]".repeat(100_000)
    );
    lab.write("r.toml", &nested);
    all_in(&lab.refused(&["run", "r.toml"]), &["r.toml, line 4"]);
    // A description in a plugin folder.
    let plugin = lab.bundle.config().join("plugins/odd");
    fs::create_dir_all(&plugin).unwrap();
    let path = plugin.join("plugin.json");
    let large = fs::File::create(&path).unwrap();
    large.set_len(3 << 30).unwrap();
    all_in(
        &lab.good(&["plugins", "list"]),
        &["refused", "plugin.json is larger than 16 MB"],
    );
    fs::write(&path, "[".repeat(1 << 20)).unwrap();
    all_in(
        &lab.good(&["plugins", "list"]),
        &["refused", "plugin.json is no valid JSON"],
    );
    let manifest = "{\"format\": \"puncta.installed/1\", \"library\": \"../x.so\", \"hash\": \"\", \
        \"door\": true, \"manifest\": {\"id\": \"x\", \"title\": \"x\", \"version\": \"1\"}}";
    fs::write(&path, manifest).unwrap();
    all_in(
        &lab.good(&["plugins", "list"]),
        &["refused", "names a library in another folder"],
    );
}
