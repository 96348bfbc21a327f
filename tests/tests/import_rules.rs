//! Which reader reads a file, and what is asked for where a file does not say its units.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::lab::Lab;

#[test]
fn the_reader_of_a_format_is_chosen_and_forgotten() {
    let lab = Lab::plain();
    lab.write("a.csv", "x [nm],y [nm]\n1,2\n");
    lab.good(&["readers", "set", ".csv", "puncta.text.read/1"]);
    let list = lab.json(&["readers", "list"]);
    assert_eq!(list["readers"][".csv"], "puncta.text.read");
    assert!(lab.good(&["info", "a.csv"]).contains("puncta.text.read/1"));
    lab.good(&["readers", "clear", ".csv"]);
    let said = lab.refused(&["readers", "clear", ".csv"]);
    assert!(said.contains("no reader was chosen for .csv"), "{said}");
    let said = lab.refused(&["readers", "set", ".csv", "test.scale/1"]);
    assert!(said.contains("is no reader"), "{said}");
}

#[test]
fn a_unit_that_nobody_says_is_asked_for_with_its_flag() {
    let lab = Lab::plain();
    lab.write("a.csv", "x,y\n1,2\n");
    lab.write("p.csv", "x [px],y [px]\n1,2\n");
    let op = |more: &[&'static str]| -> Vec<&'static str> {
        let mut all = vec!["op", "test.scale", "--factor", "1"];
        all.extend_from_slice(more);
        all
    };
    let said = lab.refused(&op(&["a.csv"]));
    assert!(said.contains("--in-units x=nm"), "{said}");
    assert!(said.contains("options.units = \"x=nm\""), "{said}");
    lab.good(&op(&["a.csv", "--in-units", "x=um,y=um"]));
    let said = lab.refused(&op(&["p.csv"]));
    assert!(said.contains("--in-pixel_size"), "{said}");
    lab.good(&op(&["p.csv", "--in-pixel_size", "100nm"]));
}
