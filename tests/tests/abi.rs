//! The ABI's promise: a committed header and layout, checked by C and C++ compilers, and a door
//! that refuses a plugin with one member changed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../xtask/src/layout.rs"]
mod layout;

use puncta_abi::LAYOUTS;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

fn abi() -> PathBuf {
    puncta_tests::root().join("plugin-api/abi")
}

/// `DeviceCore1` as C spells it: `puncta_device_core_1`.
fn c_name(name: &str) -> String {
    let mut out = String::from("puncta");
    for letter in name.chars() {
        if letter.is_uppercase() || letter.is_ascii_digit() {
            out.push('_');
        }
        out.extend(letter.to_lowercase());
    }
    out
}

fn header() -> String {
    let mut rename: HashMap<String, String> = LAYOUTS
        .iter()
        .map(|table| (table.name.to_owned(), c_name(table.name)))
        .collect();
    let mut defines = String::new();
    for (name, text) in [
        ("SYMBOL", puncta_abi::SYMBOL),
        ("CALL_1", puncta_abi::CALL_1),
        ("DATA_1", puncta_abi::DATA_1),
        ("JOB_1", puncta_abi::JOB_1),
        ("DEVICE_CORE_1", puncta_abi::DEVICE_CORE_1),
    ] {
        writeln!(defines, "#define PUNCTA_{name} \"{text}\"").unwrap();
    }
    writeln!(defines, "#define PUNCTA_EXPORTED {}", puncta_abi::SYMBOL).unwrap();
    for prefix in ["STATUS_", "KIND_", "ABI_NUMBER"] {
        for name in constants(prefix) {
            rename.insert(name.clone(), format!("PUNCTA_{name}"));
        }
    }
    let config = cbindgen::Config {
        language: cbindgen::Language::C,
        cpp_compat: true,
        include_guard: Some("PUNCTA_H".into()),
        header: Some(
            "/* Tables that Puncta's host and its plugins exchange.\n * Generated from the crate \
             puncta-abi: cargo xtask abi. */"
                .into(),
        ),
        after_includes: Some(format!("\n{defines}")),
        documentation_style: cbindgen::DocumentationStyle::C99,
        style: cbindgen::Style::Type,
        usize_is_size_t: true,
        export: cbindgen::ExportConfig {
            include: LAYOUTS.iter().map(|table| table.name.to_owned()).collect(),
            exclude: vec!["FieldLayout".into(), "TableLayout".into(), "LAYOUTS".into()],
            rename,
            ..cbindgen::ExportConfig::default()
        },
        ..cbindgen::Config::default()
    };
    let mut out = Vec::new();
    cbindgen::Builder::new()
        .with_crate(abi())
        .with_config(config)
        .generate()
        .expect("a header")
        .write(&mut out);
    plain_links(&String::from_utf8(out).expect("UTF-8"))
}

/// Links of the documentation mean nothing in C: [`X`](crate::X) becomes `X`.
fn plain_links(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(place) = rest.find("](crate::") {
        out.push_str(&rest[..place]);
        let tail = &rest[place..];
        rest = &tail[tail.find(')').map_or(tail.len(), |end| end + 1)..];
    }
    out.push_str(rest);
    out.replace("[`", "`").replace("`]", "`")
}

fn constants(prefix: &str) -> Vec<String> {
    let text = std::fs::read_to_string(abi().join("src/lib.rs")).unwrap();
    text.lines()
        .filter_map(|line| line.strip_prefix("pub const "))
        .filter_map(|line| line.split(':').next())
        .filter(|name| name.starts_with(prefix))
        .map(Into::into)
        .collect()
}

fn layout() -> String {
    let mut out = format!("ABI number {}, 64-bit\n", puncta_abi::ABI_NUMBER);
    for table in LAYOUTS {
        writeln!(
            out,
            "{} size {} align {}",
            table.name, table.size, table.align
        )
        .unwrap();
        for field in table.fields {
            writeln!(out, "  {} {}", field.offset, field.name).unwrap();
        }
    }
    out
}

/// Compares with the committed file; `cargo xtask abi` writes it anew.
fn same_as_committed(path: &Path, now: &str) {
    if std::env::var_os("PUNCTA_ABI_WRITE").is_some() {
        std::fs::write(path, now).unwrap();
    }
    let committed = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        committed == now,
        "{} is not what the crate says; run cargo xtask abi, and record the change in docs/abi.md",
        path.display()
    );
}

#[test]
fn header_and_layout_are_committed() {
    same_as_committed(&abi().join("include/puncta.h"), &header());
    same_as_committed(&abi().join("layout.txt"), &layout());
    let history = std::fs::read_to_string(puncta_tests::root().join("docs/abi.md")).unwrap();
    let row = format!("| v0_{} |", puncta_abi::ABI_NUMBER);
    assert!(
        history.contains(&row),
        "docs/abi.md has no row for the ABI number"
    );
}

/// A layout that keeps its number only gains tables: plugins that were built before still fit.
#[test]
fn the_layout_of_a_number_only_grows() {
    let number = puncta_abi::ABI_NUMBER;
    let fossil = puncta_tests::root().join(format!("tests/fossils/v0_{number}/layout.txt"));
    let fossil = std::fs::read_to_string(fossil).expect("each number has a fossil");
    let (then, now) = (
        layout::Layout::read(&fossil),
        layout::Layout::read(&layout()),
    );
    assert_eq!((then.number, now.number), (number, number));
    let found = layout::difference(&then, &now);
    assert!(found.broken.is_empty(), "{}", found.broken.join("\n"));
}

/// The compilers' view of every offset is Rust's.
fn offsets_by(compiler: &str, suffix: &str) {
    let folder = tempfile::tempdir().unwrap();
    let mut program = String::from(
        "#include <stddef.h>\n#include <stdio.h>\n#include \"puncta.h\"\nint main(void) {\n",
    );
    let mut expected = String::new();
    for table in LAYOUTS {
        let name = c_name(table.name);
        writeln!(program, "printf(\"{name} %zu\\n\", sizeof({name}));").unwrap();
        writeln!(expected, "{name} {}", table.size).unwrap();
        for field in table.fields {
            let field_name = field.name;
            writeln!(
                program,
                "printf(\"{field_name} %zu\\n\", offsetof({name}, {field_name}));"
            )
            .unwrap();
            writeln!(expected, "{field_name} {}", field.offset).unwrap();
        }
    }
    program.push_str("return 0;\n}\n");
    let source = folder.path().join(format!("offsets.{suffix}"));
    std::fs::write(&source, program).unwrap();
    let binary = folder.path().join("offsets");
    let status = Command::new(compiler)
        .args(["-Wall", "-Wextra", "-Werror", "-pedantic", "-I"])
        .arg(abi().join("include"))
        .arg(&source)
        .arg("-o")
        .arg(&binary)
        .status()
        .expect("a C compiler is installed");
    assert!(
        status.success(),
        "the header does not compile with {compiler}"
    );
    let printed = Command::new(&binary).output().unwrap();
    assert_eq!(String::from_utf8(printed.stdout).unwrap(), expected);
}

#[test]
fn offsets_in_c() {
    offsets_by("cc", "c");
}

#[test]
fn offsets_in_cpp() {
    offsets_by("c++", "cpp");
}

#[test]
fn the_door_refuses_a_doctored_plugin() {
    use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
    let doctored = puncta_tests::product(&format!("examples/{DLL_PREFIX}doctored{DLL_SUFFIX}"));
    use puncta_engine::worker::{Pool, Start};
    let workers = Pool::new(Start::new(puncta_tests::program()));
    let failure = puncta_engine::plugins::catalogue::describe(&doctored, &workers)
        .unwrap_err()
        .to_string();
    assert!(failure.contains("built with other tables"), "{failure}");
    assert!(
        failure.contains("f32") || failure.contains("Job1"),
        "{failure}"
    );
    let sound = puncta_tests::library("puncta_test_sample");
    let packed = puncta_engine::plugins::catalogue::describe(&sound, &workers).unwrap();
    assert!(packed.door && packed.manifest.id == "test.sample");
}
