use super::*;
use crate::recipe::mock::plan;
use serde_json::{Value, json};

/// A recipe with more lines; its first line has the number 6.
fn with(lines: &str) -> Checked {
    plan(&format!(
        "format = \"puncta.recipe/1\"\n[inputs.locs]\nkind = \"table\"\n[inputs.picture]\nkind = \
         \"image\"\n{lines}\n"
    ))
}

fn problems(checked: &Checked) -> Vec<String> {
    checked.problems.iter().map(ToString::to_string).collect()
}

#[test]
fn a_good_recipe_becomes_a_plan_in_order() {
    let checked = with(
        "[steps.z]\nop = \"mock.add/1\"\nin.table = \"locs\"\n[steps.b]\nop = \"mock.split/1\"\n\
         in.table = \"z\"\nset.amount = \"0.005 um\"\n[steps.a]\nop = \"mock.add/1\"\nin.other = \
         \"b.right\"\nin.table = \"b\"\n[steps.c]\nop = \"mock.image/1\"\nin.table = \
         \"locs\"\n[outputs]\n\"x.tif\" = \"c\"\n\"y.csv\" = \"a\"\n\"z.TXT\" = \"locs\"",
    );
    assert!(checked.problems.is_empty(), "{:?}", checked.problems);
    let names: Vec<&str> = checked.steps.iter().map(|step| &*step.name).collect();
    assert_eq!(names, ["c", "z", "b", "a"]);
    let (_, a) = checked.step("a").unwrap();
    let bound = |port, output| Bound {
        port,
        sources: vec![Source::Step { step: 2, output }],
    };
    assert_eq!(
        a.ports,
        [bound(0, 0), bound(1, 1)],
        "in the order of the ports"
    );
    let (_, b) = checked.step("b").unwrap();
    assert_eq!(Value::Object((*b.parameters).clone()), json!({"amount": 5}));
    assert_eq!(b.plugin.version, "1.2.3");
    let writers: Vec<&str> = checked
        .outputs
        .iter()
        .map(|one| one.writer.as_ref().unwrap().id.as_str())
        .collect();
    assert_eq!(
        writers,
        ["mock.tif.write/1", "mock.csv.write/1", "mock.csv.write/1"]
    );
    assert_eq!(
        checked.source("b.right"),
        Some(Source::Step { step: 2, output: 1 })
    );
    assert_eq!(checked.source("locs"), Some(Source::Input(0)));
    assert_eq!(checked.source("b.middle"), None);
}

/// Lines of a recipe, and what is said of them.
const MISTAKES: &[(&str, &str)] = &[
    (
        "[steps.a]\nop = \"mock.ad/1\"",
        "line 7, column 6: step a: mock.ad/1 is not installed; did you mean mock.add/1?",
    ),
    (
        "[steps.a]\nop = \"mock.add/2\"",
        "mock.add/2 is not installed; installed is mock.add/1, whose",
    ),
    (
        "[steps.a]\nop = \"lab.secret/1\"",
        "lab.secret/1 is not installed; install the plugin",
    ),
    (
        "[steps.a]\nop = \"mock.csv.read/1\"",
        "mock.csv.read/1 is a reader and no operation; name it in",
    ),
    (
        "[steps.a]\nop = \"mock.csv.write/1\"\nin.object = \"locs\"",
        "is a writer and no operation",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = \"loks\"",
        "line 8, column 12: step a: there is no input or step loks; did you mean locs?",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.tabel = \"locs\"",
        "line 8, column 4: step a: mock.add/1 has no input tabel; did you mean table?",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"",
        "line 6, column 8: step a: nothing is bound to its input table; add in.table",
    ),
    (
        "[steps.a]\nop = \"mock.join/1\"\nin.tables = []",
        "nothing is bound to its input tables",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = \"picture\"",
        "its input table takes a table, and picture is an image; bind a table",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = [\"locs\", \"locs\"]",
        "its input table takes one object, not 2",
    ),
    (
        "[steps.p]\nop = \"mock.parts/1\"\nin.table = \"locs\"\n[steps.a]\nop = \"mock.add/1\"\nin.table = \"p\"",
        "takes one object, and p may be several",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = \"locs.x\"",
        "locs is an input and has no output x; say object = \"x\" in [inputs.locs]",
    ),
    (
        "[steps.s]\nop = \"mock.split/1\"\nin.table = \"locs\"\n[steps.a]\nop = \"mock.add/1\"\nin.table = \"s.lefd\"",
        "the step s has no output lefd; did you mean left?",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = \"locs\"\nset.amount = 2000",
        "line 9, column 5: step a: parameter amount is 2000 nm, above 1000 nm",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = \"locs\"\nset.amont = 2",
        "there is no parameter amont; did you mean amount?",
    ),
    (
        "[steps.a]\nop = \"mock.add/1\"\nin.table = \"locs\"\nset.zzz = 2",
        "there is no parameter zzz; there are amount",
    ),
    (
        "[steps.a]\nop = \"mock.range/1\"\nin.table = \"locs\"",
        "parameter ranges needs a value",
    ),
    (
        "[steps.a]\nop = \"mock.range/1\"\nin.table = \"locs\"\nset.ranges = { x = [\"1 mile\", 2] }",
        "parameter ranges has the limit \"1 mile\" of x",
    ),
    (
        "[inputs.b]\nkind = \"table\"\nreader = \"mock.csv.raed/1\"",
        "input b: mock.csv.raed/1 is not installed; did you mean mock.csv.read/1?",
    ),
    (
        "[inputs.b]\nkind = \"table\"\nreader = \"mock.add/1\"",
        "mock.add/1 is an operation and not a reader",
    ),
    (
        "[inputs.b]\nkind = \"table\"\nreader = \"mock.csv.read/1\"\noptions.amount = \"x\"",
        "input b: parameter amount cannot be read",
    ),
    (
        "[outputs]\n\"a.xyz\" = \"locs\"",
        "no installed plugin writes files of this name; let it end with one of .any .csv",
    ),
    (
        "[outputs]\n\"a.csv\" = \"nothing\"",
        "output file \"a.csv\": there is no input or step nothing",
    ),
    (
        "[outputs]\n\"a.csv\" = { from = \"locs\", set = { b = 1 } }",
        "there is no parameter b",
    ),
    (
        "[steps.p]\nop = \"mock.parts/1\"\nin.table = \"locs\"\n[outputs]\n\"a.csv\" = \"p\"",
        "writes one object, and p may be several",
    ),
];

#[test]
fn every_mistake_is_named() {
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
fn problems_are_collected_in_the_order_of_the_text() {
    let checked = with(
        "[steps.b]\nop = \"mock.add/1\"\nin.tabel = \"locs\"\nset = { amount = -5, amuont = 1 }\n\
         [steps.a]\nop = \"gone/1\"\nin.x = \"nothing\"\n[outputs]\n\"a.q\" = \"a\"",
    );
    let lines: Vec<u32> = checked
        .problems
        .iter()
        .map(|problem| problem.place.line)
        .collect();
    assert_eq!(lines, [6, 8, 9, 11, 12, 14], "{:#?}", problems(&checked));
    assert!(checked.steps.iter().all(|step| step.failure.is_some()));
    let (_, a) = checked.step("a").unwrap();
    assert!(a.operation.is_none());
    assert!(
        a.failure
            .as_ref()
            .unwrap()
            .to_string()
            .contains("not installed")
    );
    assert_eq!(
        checked.outputs[0].source,
        Some(Source::Step { step: 0, output: 0 })
    );
}

#[test]
fn a_step_that_is_not_installed_gives_no_other_errors() {
    let checked = with(
        "[steps.a]\nop = \"gone/1\"\nin.x = \"locs\"\nset.anything = [1]\n[steps.b]\nop = \
         \"mock.add/1\"\nin.table = \"a.some\"\n[outputs]\n\"b.csv\" = \"b\"",
    );
    assert_eq!(checked.problems.len(), 1, "{:?}", checked.problems);
    assert!(checked.step("b").unwrap().1.failure.is_none());
}

#[test]
fn circles_are_named_with_their_steps() {
    let step = |name: &str, from: &str| {
        format!("[steps.{name}]\nop = \"mock.add/1\"\nin.table = \"{from}\"\n")
    };
    let text =
        step("a", "c") + &step("b", "a") + &step("c", "b") + &step("d", "b") + &step("e", "locs");
    let checked = with(&text);
    let found = problems(&checked);
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(found[0].contains(
        "line 8, column 4: step a waits for its own result: a needs c needs b needs a; bind"
    ));
    assert!(checked.step("d").unwrap().1.failure.is_none());
    assert!(checked.step("e").unwrap().1.failure.is_none());
    let own = with(&step("a", "a"));
    assert!(problems(&own)[0].contains("a needs a"));
}
