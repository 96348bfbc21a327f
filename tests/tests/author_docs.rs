//! The author's guide: its code is that of the templates, which the tests compile; its references
//! are what the code says. `PUNCTA_DOCS_WRITE=1` writes the references anew.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{program, root};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn guide() -> PathBuf {
    root().join("docs/plugin-author")
}

fn files(folder: &Path, into: &mut Vec<PathBuf>) {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .flatten()
        .map(|entry| entry.path())
        .collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            files(&path, into);
        } else {
            into.push(path);
        }
    }
}

/// Code without what a page may leave out: indentation and empty lines.
fn plain(code: &str) -> String {
    let lines = code.lines().map(str::trim).filter(|line| !line.is_empty());
    lines.collect::<Vec<_>>().join("\n")
}

/// Language and text of the fenced blocks of a page.
fn blocks(page: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut open: Option<(String, String)> = None;
    for line in page.lines() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(language), None) => open = Some((language.trim().to_owned(), String::new())),
            (Some(_), Some(_)) => found.extend(open.take()),
            (None, Some((_, text))) => {
                text.push_str(line);
                text.push('\n');
            }
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "a block is not closed");
    found
}

#[test]
fn every_block_of_code_is_compiled_by_the_tests() {
    let mut sources = Vec::new();
    files(&root().join("sdk-template"), &mut sources);
    let read = |path: &PathBuf| plain(&fs::read_to_string(path).unwrap_or_default());
    let sources: Vec<String> = sources.iter().map(read).collect();
    let mut pages = Vec::new();
    files(&guide(), &mut pages);
    let mut count = 0;
    for page in pages {
        let text = fs::read_to_string(&page).unwrap();
        for (language, code) in blocks(&text) {
            let shown = format!("{}: {code}", page.display());
            match language.as_str() {
                "rust" | "c" | "toml" => {
                    let code = plain(&code);
                    let there = sources.iter().any(|source| source.contains(&code));
                    assert!(there, "no template has this code, {shown}");
                }
                "json" => drop(serde_json::from_str::<Value>(&code).expect(&shown)),
                // What is typed at a terminal.
                "text" => {}
                other => panic!("a block in {other:?}, {shown}"),
            }
            count += 1;
        }
    }
    assert!(count >= 8, "only {count} blocks");
}

/// Compares a generated page with the committed one.
fn same(name: &str, text: &str) {
    let path = guide().join(name);
    if std::env::var_os("PUNCTA_DOCS_WRITE").is_some() {
        fs::write(&path, text).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        committed == text,
        "{name} is not what the code says; run the test with PUNCTA_DOCS_WRITE=1"
    );
}

#[test]
fn the_checks_are_listed() {
    let output = Command::new(program())
        .args(["plugins", "check", "--list", "--json"])
        .env(
            "PUNCTA_CONFIG",
            std::env::temp_dir().join("puncta-no-config"),
        )
        .output()
        .unwrap();
    let list: Value = serde_json::from_slice(&output.stdout).unwrap();
    let checks = list["checks"].as_array().unwrap();
    let mut page = format!(
        "# The {} checks of `puncta plugins check`\n\n\
         Generated from the code. A check runs from its strictness on (5 if nothing is said), in a process of its own with a time\n\
         limit, and only if the checks that it needs passed.\n\n\
         | check | strictness | asks | needs |\n| --- | --- | --- | --- |\n",
        checks.len()
    );
    for check in checks {
        let needs = check["needs"].as_array().unwrap().iter();
        let needs: Vec<&str> = needs.filter_map(Value::as_str).collect();
        writeln!(
            page,
            "| `{}` | {} | {} | {} |",
            check["check"].as_str().unwrap(),
            check["strictness"],
            check["sentence"].as_str().unwrap(),
            needs.join(", ")
        )
        .unwrap();
    }
    same("checks.md", &page);
}

/// A public item of a source file: how deep it stands, its declaration, its first paragraph.
struct Item {
    indent: usize,
    declaration: String,
    said: String,
}

/// Public items of a source file, with what is said of them; tests are left out.
fn items(text: &str) -> Vec<Item> {
    let code = text.split("#[cfg(test)]").next().unwrap_or("");
    let mut found: Vec<Item> = Vec::new();
    let mut said: Vec<&str> = Vec::new();
    let mut ended = false;
    let mut in_trait = false;
    for line in code.lines() {
        in_trait = line.starts_with("pub trait") || (in_trait && line != "}");
        let bare = line.trim_start();
        let indent = line.len() - bare.len();
        if let Some(doc) = bare.strip_prefix("///") {
            let doc = doc.trim();
            ended |= doc.is_empty() || doc.starts_with('#');
            if !ended {
                said.push(doc);
            }
            continue;
        }
        let open = bare.starts_with("#[") || bare.starts_with("pub(") || bare.is_empty();
        let public = bare.strip_prefix("pub ");
        // Methods of traits are public without the word.
        let public = public.or((in_trait && bare.starts_with("fn ")).then_some(bare));
        let kind = public.filter(|rest| {
            let word = rest.split([' ', '(']).next().unwrap_or("");
            matches!(word, "fn" | "struct" | "enum" | "trait" | "const" | "type")
                || rest.contains(": ")
        });
        if let Some(rest) = kind
            && !said.is_empty()
        {
            let end = rest.find(" {").or(rest.find(" =")).unwrap_or(rest.len());
            let declaration = rest[..end].trim_end_matches([',', ';', '(']).to_owned();
            let said = std::mem::take(&mut said).join(" ");
            found.push(Item {
                indent,
                declaration,
                said,
            });
        }
        if !open || bare.starts_with("pub(") {
            said.clear();
        }
        if !bare.starts_with("#[") {
            said.clear();
            ended = false;
        }
    }
    found
}

fn head(text: &str) -> String {
    let lines = text.lines().map_while(|line| line.strip_prefix("//!"));
    let first = lines.map(str::trim).take_while(|line| !line.is_empty());
    first.collect::<Vec<_>>().join(" ")
}

/// A page with the public items of some source files.
fn reference(title: &str, folder: &str, names: &[&str]) -> String {
    let mut page = format!("# {title}\n\nGenerated from `{folder}`.\n");
    for name in names {
        let text = fs::read_to_string(root().join(folder).join(format!("{name}.rs"))).unwrap();
        write!(page, "\n## {name}\n\n{}\n\n", head(&text)).unwrap();
        for item in items(&text) {
            let space = if item.indent > 0 { "  " } else { "" };
            writeln!(page, "{space}- `{}`: {}", item.declaration, item.said).unwrap();
        }
    }
    page
}

#[test]
fn the_sdk_is_listed() {
    let names = [
        "operation",
        "info",
        "params",
        "job",
        "input",
        "output",
        "run",
    ];
    let page = reference("The SDK", "plugin-api/sdk/src", &names);
    for word in [
        "fn add_columns",
        "fn f64_mut",
        "trait Operation",
        "fn progress",
    ] {
        assert!(page.contains(word), "{word} is missing");
    }
    same("sdk.md", &page);
}

#[test]
fn the_documents_are_listed() {
    let names = [
        "manifest", "schema", "call", "header", "findings", "failure", "element",
    ];
    let page = reference("The control documents", "plugin-api/documents/src", &names);
    for word in [
        "struct Manifest",
        "reentrant: bool",
        "struct Plan",
        "interruptible: bool",
    ] {
        assert!(page.contains(word), "{word} is missing");
    }
    same("documents.md", &page);
}
