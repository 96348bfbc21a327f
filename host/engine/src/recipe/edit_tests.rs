use super::*;
use serde_json::json;

/// Odd but valid spacing, order and spelling, to be left alone.
const ODD: &str = "\u{feff}# head\r
format='puncta.recipe/1'   # the format\r
\r
[ inputs . locs ]\t# spaced\r
\"kind\"   =   'table'\r
\r
  [steps.good]\r
    # above the operation\r
    op = \"mock.range/1\" # id\r
    set.ranges = { error_x = [0 , 15],   t = [5_00, +inf] } # limits\r
    in.table = \"locs\"\r
    set.amount = 1e0\r
\r
# Renders.\r
# In two lines.\r
[steps.image]\r
op = 'mock.image/1'\r
in = { table = \"good.table\" }   \r
[steps.image.set] # parameters\r
amount = 5 # nm\r
\r
# apart\r
\r
# the files\r
[outputs]\r
\"{input}.tif\" = \"image\"\r
\"a.csv\" = { from = \"good\" , set = {} }\r
# the end";

/// The lines that differ: those of the old text, and those of the new.
fn changed(old: &str, new: &str) -> (Vec<String>, Vec<String>) {
    let lines = |text: &str| {
        text.split_inclusive('\n')
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let (old, new) = (lines(old), lines(new));
    let before = old.iter().zip(&new).take_while(|(a, b)| a == b).count();
    let (old, new) = (&old[before..], &new[before..]);
    let after = old
        .iter()
        .rev()
        .zip(new.iter().rev())
        .take_while(|(a, b)| a == b)
        .count();
    (
        old[..old.len() - after].to_vec(),
        new[..new.len() - after].to_vec(),
    )
}

fn set(step: &str, parameter: &str, value: serde_json::Value) -> (Vec<String>, Vec<String>) {
    changed(ODD, &set_parameter(ODD, step, parameter, &value).unwrap())
}

fn lines(list: &[&str]) -> Vec<String> {
    list.iter().map(|line| format!("{line}\r\n")).collect()
}

#[test]
fn setting_a_parameter_changes_its_value_only() {
    assert_eq!(
        set("image", "amount", json!(7.5)),
        (lines(&["amount = 5 # nm"]), lines(&["amount = 7.5 # nm"]))
    );
    assert_eq!(
        set("good", "amount", json!(1)),
        (vec![], vec![]),
        "1e0 is 1"
    );
    assert_eq!(
        set(
            "good",
            "ranges",
            json!({"error_x": [0, 20], "t": [500, "inf"]})
        ),
        (
            lines(&["    set.ranges = { error_x = [0 , 15],   t = [5_00, +inf] } # limits"]),
            lines(&["    set.ranges = { error_x = [0 , 20],   t = [5_00, +inf] } # limits"])
        )
    );
    assert_eq!(
        set(
            "good",
            "ranges",
            json!({"t": [500, "inf"], "x": ["-inf", "15 nm"]})
        )
        .1,
        lines(&["    set.ranges = { t = [5_00, +inf], x = [-inf, \"15 nm\"] } # limits"])
    );
    assert_eq!(
        set("good", "ranges", json!({})).1,
        lines(&["    set.ranges = {} # limits"])
    );
}

#[test]
fn new_parameters_go_beside_the_others() {
    assert_eq!(
        set("good", "new", json!("a\"b")),
        (vec![], lines(&["    set.new = \"a\\\"b\""]))
    );
    assert_eq!(
        set("image", "new", json!(true)),
        (vec![], lines(&["new = true"]))
    );
    let text = "format = \"puncta.recipe/1\"\n[steps.a]\nop = \"x\"";
    let with = |text: &str| set_parameter(text, "a", "b c", &json!([1, "inf"])).unwrap();
    assert_eq!(with(text), format!("{text}\nset.\"b c\" = [1, inf]\n"));
    let inline = |set: &str| format!("{text}\nset = {set}\n");
    assert_eq!(with(&inline("{}")), inline("{ \"b c\" = [1, inf] }"));
    assert_eq!(
        with(&inline("{ p = 1 }")),
        inline("{ p = 1, \"b c\" = [1, inf] }")
    );
    assert_eq!(
        with(&inline("{\n  p = 1, # one\n}")),
        inline("{\n  p = 1, \"b c\" = [1, inf], # one\n}")
    );
    let flat = "format = \"puncta.recipe/1\"\nsteps.a.op = \"x\"\nsteps.b.op = \"y\"\n";
    assert_eq!(
        with(flat),
        "format = \"puncta.recipe/1\"\nsteps.a.op = \"x\"\nsteps.a.set.\"b c\" = [1, inf]\nsteps.b.op = \"y\"\n"
    );
    let whole = "format = \"puncta.recipe/1\"\nsteps = { a = { op = \"x\" } }\n";
    assert_eq!(
        with(whole),
        whole.replace("\"x\" }", "\"x\", set.\"b c\" = [1, inf] }")
    );
}

#[test]
fn removing_a_parameter_leaves_the_rest() {
    let remove = |step, name| changed(ODD, &remove_parameter(ODD, step, name).unwrap());
    assert_eq!(
        remove("image", "amount"),
        (lines(&["amount = 5 # nm"]), vec![])
    );
    assert_eq!(
        remove("good", "amount"),
        (lines(&["    set.amount = 1e0"]), vec![])
    );
    assert_eq!(remove("good", "nothing"), (vec![], vec![]));
    let text =
        "format = \"puncta.recipe/1\"\n[steps.a]\nop = \"x\"\nset = { p = 1, q = 2 , r = 3 }\n";
    for (name, left) in [
        ("p", "{ q = 2 , r = 3 }"),
        ("q", "{ p = 1, r = 3 }"),
        ("r", "{ p = 1, q = 2 }"),
    ] {
        let wanted = text.replace("{ p = 1, q = 2 , r = 3 }", left);
        assert_eq!(remove_parameter(text, "a", name).unwrap(), wanted);
        assert_eq!(
            set_parameter(text, "a", name, &json!(null)).unwrap(),
            wanted
        );
    }
    let one = text.replace("{ p = 1, q = 2 , r = 3 }", "{ p = 1 }");
    assert_eq!(
        remove_parameter(&one, "a", "p").unwrap(),
        text.replace("{ p = 1, q = 2 , r = 3 }", "{}")
    );
}

#[test]
fn steps_are_removed_with_the_comment_above_them() {
    let text = remove_step(ODD, "image").unwrap();
    let (old, new) = changed(ODD, &text);
    assert!(new.is_empty());
    assert_eq!(old[0], "# Renders.\r\n");
    assert_eq!(old.last().unwrap(), "\r\n");
    assert_eq!(old.len(), 8);
    assert!(text.contains("# apart\r\n\r\n# the files\r\n[outputs]"));
    let text = remove_step(ODD, "good").unwrap();
    assert!(text.contains("'table'\r\n\r\n# Renders.\r\n"), "{text}");
}

#[test]
fn steps_are_added_after_the_last_one() {
    let mut set = Map::new();
    set.insert("amount".into(), json!(3));
    let text = add_step(
        ODD,
        "more",
        "mock.add/1",
        &[("table", &["good"]), ("other", &["image", "x"])],
        &set,
    )
    .unwrap();
    let (old, new) = changed(ODD, &text);
    assert!(old.is_empty());
    assert_eq!(
        new,
        lines(&[
            "[steps.more]",
            "op = \"mock.add/1\"",
            "in.table = \"good\"",
            "in.other = [\"image\", \"x\"]",
            "set.amount = 3",
            ""
        ])
    );
    assert!(
        text.contains("amount = 5 # nm\r\n\r\n[steps.more]"),
        "{text}"
    );
    // The first step of a recipe comes before the outputs.
    let bare = "format = \"puncta.recipe/1\"\n[inputs.a]\nkind = \"table\"\n# files\n[outputs]\n\"a.csv\" = \"a\"\n";
    assert_eq!(
        add_step(bare, "s", "x/1", &[], &Map::new()).unwrap(),
        bare.replace("# files", "\n[steps.s]\nop = \"x/1\"\n\n# files")
    );
    for name in ["good", "locs", "a b", "", "a.b"] {
        assert!(
            add_step(ODD, name, "x", &[], &Map::new()).is_err(),
            "{name}"
        );
    }
}

#[test]
fn renaming_changes_every_reference() {
    let text = rename_step(ODD, "good", "better").unwrap();
    let expected = ODD
        .replace("[steps.good]", "[steps.better]")
        .replace("\"good.table\"", "\"better.table\"")
        .replace("from = \"good\"", "from = \"better\"");
    assert_eq!(text, expected);
    let text = rename_step(ODD, "image", "picture").unwrap();
    let expected = ODD
        .replace("[steps.image", "[steps.picture")
        .replace("= \"image\"", "= \"picture\"");
    assert_eq!(text, expected);
    assert_eq!(rename_step(&text, "picture", "image").unwrap(), ODD);
    let inline = "format = \"puncta.recipe/1\"\nsteps = { a = { op = \"x\", in.t = [\"b\", \"b.o\", \"bb\"] }, b.op = \"y\" }\n";
    assert_eq!(
        rename_step(inline, "b", "c").unwrap(),
        inline
            .replace("[\"b\", \"b.o\"", "[\"c\", \"c.o\"")
            .replace("b.op", "c.op")
    );
    assert!(rename_step(ODD, "good", "locs").is_err());
    assert!(
        rename_step(ODD, "god", "x")
            .unwrap_err()
            .to_string()
            .contains("did you mean good?")
    );
}

#[test]
fn inputs_are_bound_and_unbound() {
    let bind = |step, port, from: &[&str]| changed(ODD, &rebind(ODD, step, port, from).unwrap());
    assert_eq!(
        bind("good", "table", &["image"]).1,
        lines(&["    in.table = \"image\""])
    );
    assert_eq!(
        bind("image", "mask", &["a", "b"]).1,
        lines(&["in = { table = \"good.table\", mask = [\"a\", \"b\"] }   "])
    );
    assert_eq!(
        bind("good", "table", &[]),
        (lines(&["    in.table = \"locs\""]), vec![])
    );
    assert_eq!(bind("good", "table", &["locs"]), (vec![], vec![]));
    let list = "format = \"puncta.recipe/1\"\n[steps.a]\nop = \"x\"\nin.t = [\"b\"] # some\n";
    assert_eq!(
        rebind(list, "a", "t", &["c"]).unwrap(),
        list.replace("\"b\"", "\"c\"")
    );
    assert_eq!(
        rebind(list, "a", "t", &["b", "c"]).unwrap(),
        list.replace("\"b\"", "\"b\", \"c\"")
    );
}

#[test]
fn inputs_options_and_outputs_are_edited() {
    let text = add_input(ODD, "cells", Kind::Image).unwrap();
    assert_eq!(
        changed(ODD, &text).1,
        lines(&["[inputs.cells]", "kind = \"image\"", ""])
    );
    let with = set_option(&text, "cells", "units", &json!({"x": "nm"})).unwrap();
    assert_eq!(
        changed(&text, &with).1,
        lines(&["options.units = { x = \"nm\" }"])
    );
    let without = set_option(&with, "cells", "units", &json!(null)).unwrap();
    assert_eq!(without, text);
    assert!(set_option(ODD, "cells", "a", &json!(1)).is_err());

    let out = |file, from| changed(ODD, &set_output(ODD, file, from).unwrap());
    assert_eq!(
        out("b.csv", Some("good")).1,
        lines(&["\"b.csv\" = \"good\""])
    );
    assert_eq!(
        out("a.csv", Some("image")).1,
        lines(&["\"a.csv\" = { from = \"image\" , set = {} }"])
    );
    assert_eq!(
        out("{input}.tif", None),
        (lines(&["\"{input}.tif\" = \"image\""]), vec![])
    );
    assert!(set_output(ODD, "../b.csv", Some("good")).is_err());
    let bare = "format = \"puncta.recipe/1\"\n[inputs.a]\nkind = \"table\"";
    assert_eq!(
        set_output(bare, "b.csv", Some("a")).unwrap(),
        format!("{bare}\n\n[outputs]\n\"b.csv\" = \"a\"\n")
    );
    let first = add_input("format = \"puncta.recipe/1\"", "a", Kind::Table).unwrap();
    assert_eq!(
        first,
        "format = \"puncta.recipe/1\"\n\n[inputs.a]\nkind = \"table\"\n"
    );
}

#[test]
fn a_recipe_with_errors_is_not_edited() {
    let failure = set_parameter("format = 1", "a", "b", &json!(1)).unwrap_err();
    assert!(
        failure.to_string().contains("line 1, column 10"),
        "{failure}"
    );
    let failure = set_parameter(ODD, "a", "b", &json!(1)).unwrap_err();
    assert!(
        failure.to_string().contains("there is no step a"),
        "{failure}"
    );
}
