use super::*;
use crate::recipe::random::Random;
use puncta_documents::Kind;
use serde_json::{Value, json};

const GOOD: &str = r#"# A comment.
format = "puncta.recipe/1"

[inputs.locs]
kind = "table"
reader = "puncta.text.read/1"
options = { units = { x = "nm" }, skip = 2 }
object = "localisations"
[inputs.cells]
kind = "image"
many = true

[steps.good]
op = "puncta.filter.range/1"
in.table = "locs"
set.ranges = { error_x = [0, 15], t = [500, inf], z = [-inf, nan] }
set.label = "15 nm"

[steps.image]
op = "some.plugin.that.is.not.there/7"
in.table = ["good.table", "locs"]
in.mask = "cells"
[steps.image.set]
pixel_size = 5.0
seed = 18446744073709551615

[outputs]
"images/{input}.tif" = "image"
"a.csv" = { from = "good.table", writer = "puncta.text.write/1", set = { digits = 3 } }
"#;

fn problems(text: &str) -> Vec<String> {
    match parse(text) {
        Ok(_) => Vec::new(),
        Err(problems) => problems.iter().map(ToString::to_string).collect(),
    }
}

/// A recipe with more lines; its first line has the number 4.
fn with(lines: &str) -> String {
    format!("format = \"{RECIPE}\"\n[inputs.locs]\nkind = \"table\"\n{lines}\n")
}

#[test]
fn inputs_and_outputs_are_read() {
    let recipe = parse(GOOD).unwrap();
    assert_eq!(recipe.inputs.len(), 2);
    let locs = recipe.input("locs").unwrap();
    assert_eq!((locs.kind, locs.many), (Kind::Table, false));
    assert_eq!(locs.reader.as_deref(), Some("puncta.text.read/1"));
    assert_eq!(
        Value::Object(locs.options.clone()),
        json!({"units": {"x": "nm"}, "skip": 2})
    );
    assert_eq!(locs.object.as_deref(), Some("localisations"));
    assert!(recipe.input("cells").unwrap().many);
    assert_eq!(recipe.outputs[0].file, "images/{input}.tif");
    assert_eq!(
        recipe.outputs[1].writer.as_deref(),
        Some("puncta.text.write/1")
    );
    assert_eq!(recipe.outputs[1].from.output.as_deref(), Some("table"));
    assert_eq!(recipe.outputs[1].set["digits"], 3);
}

#[test]
fn steps_are_read() {
    let recipe = parse(GOOD).unwrap();
    let names: Vec<&str> = recipe.steps.iter().map(|step| step.name.as_str()).collect();
    assert_eq!(names, ["good", "image"]);
    let good = recipe.step("good").unwrap();
    assert_eq!(
        Value::Object(good.set.clone()),
        json!({
            "ranges": {"error_x": [0, 15], "t": [500, "inf"], "z": ["-inf", "nan"]},
            "label": "15 nm"
        })
    );
    assert_eq!(
        good.place,
        Place {
            line: 13,
            column: 8
        }
    );
    assert_eq!(
        good.op_place,
        Place {
            line: 14,
            column: 6
        }
    );
    assert_eq!(
        good.set_places["label"],
        Place {
            line: 17,
            column: 5
        }
    );
    let image = recipe.step("image").unwrap();
    assert_eq!(
        Value::Object(image.set.clone()),
        json!({"pixel_size": 5, "seed": 18446744073709551615_u64})
    );
    let bound: Vec<String> = image.inputs[0]
        .from
        .iter()
        .map(ToString::to_string)
        .collect();
    assert_eq!(
        (image.inputs[0].port.as_str(), bound),
        ("table", vec!["good.table".into(), "locs".into()])
    );
}

/// Lines of a recipe, and what is said of them.
const MISTAKES: &[(&str, &str)] = &[
    (
        "[step.a]",
        "line 4, column 2: the recipe has no key \"step\"; did you mean steps?",
    ),
    (
        "[inputs.b]\nkinds = 1",
        "line 5, column 1: the input b has no key \"kinds\"; did you mean kind?",
    ),
    (
        "[inputs.b]",
        "line 4, column 9: the input b does not say its kind; add kind = one of",
    ),
    (
        "[inputs.b]\nkind = \"points\"",
        "line 5, column 8: the input b has an unknown kind; use one of",
    ),
    (
        "[inputs.b]\nkind = \"mesh\"\nmany = 1",
        "line 6, column 8: many of the input b is neither true nor false",
    ),
    (
        "[inputs.b]\nkind = 1",
        "line 5, column 8: kind is no text; put it into double quotes",
    ),
    (
        "[inputs.b]\nkind=\"mesh\"\noptions = 1",
        "line 6, column 11: options is no table",
    ),
    (
        "[steps.\"a b\"]\nop = \"x\"",
        "line 4, column 8: \"a b\" cannot be the name of a step; use up to 64",
    ),
    (
        "[steps.\"a.b\"]\nop = \"x\"",
        "cannot be the name of a step",
    ),
    (
        "[steps.a]",
        "line 4, column 8: the step a does not say its operation; add op",
    ),
    (
        "[steps.a]\nop = \"x\"\nsets.b = 1",
        "line 6, column 1: the step a has no key \"sets\"; did you mean set?",
    ),
    (
        "[steps.a]\nop = \"x\"\nin.t = 5",
        "line 6, column 8: t of the step a names no input, step",
    ),
    (
        "[steps.a]\nop = \"x\"\nin.t = [\"b\", 5]",
        "line 6, column 14: t of the step a names no input",
    ),
    ("[steps.a]\nop = \"x\"\nin.t = \"b.\"", "names no input"),
    (
        "[steps.a]\nop = \"x\"\nin = \"b\"",
        "line 6, column 6: in is no table",
    ),
    (
        "[steps.a]\nop = \"x\"\nset.d = 1979-05-27",
        "line 6, column 9: 1979-05-27 is a date",
    ),
    (
        "[steps.a]\nop = \"x\"\nset.d = 1e999",
        "line 6, column 9: the number 1e999 is too large",
    ),
    (
        "[steps.locs]\nop = \"x\"",
        "line 4, column 8: the step locs has the name of the input in line 2",
    ),
    (
        "[outputs]\n\"../x.tif\" = \"locs\"",
        "line 5, column 1: the output file \"../x.tif\" leaves the output folder",
    ),
    ("[outputs]\n\"/x.tif\" = \"locs\"", "is an absolute path"),
    (
        "[outputs]\n\"x.tif\" = { writer = \"w\" }",
        "does not say what is written; add from",
    ),
    (
        "[outputs]\n\"x.tif\" = { form = \"w\", from = \"locs\" }",
        "has no key \"form\"; did you mean from?",
    ),
    ("[outputs]\na.tif = \"locs\"", "has no key \"tif\""),
    (
        "[outputs]\n\"a\" = \"locs\"\n\"A\" = \"locs\"",
        "line 6, column 1: the output file \"A\" differs from that in line 5",
    ),
    ("outputs = 1", "the input locs has no key \"outputs\""),
];

#[test]
fn every_mistake_is_named_with_its_place_and_a_remedy() {
    for (lines, wanted) in MISTAKES {
        let found = problems(&with(lines));
        assert!(
            found.iter().any(|problem| problem.contains(wanted)),
            "{lines}\n{found:#?}"
        );
        assert!(
            found.iter().all(|problem| !problem.contains('\n')),
            "{found:?}"
        );
    }
}

#[test]
fn syntax_errors_and_names_that_stand_twice_are_named() {
    for (lines, wanted) in [
        (
            "[steps.a]\nop = x",
            "line 5, column 6: this is no valid TOML: string values must be quoted",
        ),
        ("[steps.a", "line 4, column 9: this is no valid TOML"),
        (
            "[steps.a]\nop = \"x\nin.t = 1",
            "line 5, column 8: this is no valid TOML",
        ),
        (
            "[steps.a]\nop = \"x\"\n[steps.b]\nop = \"x\"\n[steps.a]\nop = \"y\"",
            "line 8, column 8: the name a stands twice, first in line 4; rename or remove",
        ),
        (
            "[steps.a]\nop = \"x\"\nop = \"y\"",
            "line 6, column 1: the name op stands twice, first in line 5",
        ),
        (
            "[steps.a]\nset = { u = 1, u = 2 }",
            "the name u stands twice, first in line 5",
        ),
    ] {
        let found = problems(&with(lines));
        assert!(found[0].contains(wanted), "{lines}\n{found:#?}");
    }
    // A section that stands twice gives one message, however many keys it repeats.
    let twice = "[steps.a]\nop = \"x\"\nin.t = \"locs\"\n";
    assert_eq!(problems(&with(&twice.repeat(2))).len(), 1);
    let both = problems(&with("[steps.a]\nop = x\n[steps.b]\nop = y"));
    assert_eq!(both.len(), 2, "{both:?}");
}

#[test]
fn other_formats_and_sizes_are_refused() {
    for (text, wanted) in [
        (
            "",
            "line 1, column 1: this is no recipe; the first line has to be format",
        ),
        ("format = 1", "the format is not that of a recipe"),
        (
            "format = \"puncta.recipe/2\"",
            "of another version; update Puncta",
        ),
        ("x,y\n1,2\n", "no valid TOML"),
    ] {
        let found = problems(text);
        assert!(found[0].contains(wanted), "{text}\n{found:#?}");
    }
    let found = problems(&" ".repeat(MAX_TEXT + 1));
    assert!(found[0].contains("more than the 16 MB"), "{found:?}");
    let many: String = (0..=MAX_ENTRIES)
        .map(|at| format!("[steps.s{at}]\nop = \"x\"\n"))
        .collect();
    let found = problems(&with(&many));
    assert!(
        found[0].contains("there are 10001 steps, more than 10000"),
        "{found:?}"
    );
    let deep = format!("[steps.a]\nop = \"x\"\nset.v = {}", "[".repeat(100_000));
    assert!(!problems(&with(&deep)).is_empty());
    let wrong: String = (0..5000).map(|at| format!("[steps.s{at}]\n")).collect();
    assert_eq!(problems(&with(&wrong)).len(), MOST_PROBLEMS);
}

#[test]
fn damaged_recipes_never_panic() {
    let mut random = Random::new(1);
    let parts: Vec<&str> = GOOD.split_inclusive(['\n', ' ', '.', '=']).collect();
    let mock = crate::recipe::mock::Mock::new();
    for round in 0..10_000 {
        let mut bytes: Vec<u8> = match random.below(4) {
            // Lines and words in another order, or twice.
            0 => (0..parts.len())
                .flat_map(|_| random.pick(&parts).bytes())
                .collect(),
            _ => GOOD.bytes().collect(),
        };
        for _ in 0..random.below(6) {
            let at = random.below(bytes.len().max(1));
            match random.below(5) {
                0 => bytes.truncate(at),
                1 => bytes.insert(at, *random.pick(b"[]{}\"'.,=#\n\\\0\x7f_-+e1")),
                2 => drop(bytes.remove(at)),
                3 => bytes[at] ^= 1 << random.below(8),
                _ => {
                    let end = (at + random.below(40)).min(bytes.len());
                    let piece = bytes[at..end].to_vec();
                    let to = random.below(bytes.len());
                    bytes.splice(to..to, piece);
                }
            }
            if bytes.is_empty() {
                break;
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        match parse(&text) {
            Ok(recipe) => {
                crate::recipe::check(&recipe, &mock);
                for step in recipe.steps.iter().filter(|_| round % 10 == 0) {
                    let _ = crate::recipe::edit::set_parameter(&text, &step.name, "p", &json!(1));
                    let _ = crate::recipe::edit::remove_step(&text, &step.name);
                    let _ = crate::recipe::edit::rename_step(&text, &step.name, "other");
                }
            }
            Err(problems) => {
                assert!(!problems.is_empty(), "{text}");
                assert!(problems.iter().all(|problem| problem.place.line > 0));
            }
        }
    }
}
