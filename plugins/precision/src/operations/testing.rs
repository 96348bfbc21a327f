//! What the tests of the operations share.

use puncta_testkit::Done;
pub(crate) use puncta_testkit::Random;

/// A value of the report, and its interval.
pub(crate) fn value(done: &Done, name: &str) -> (f64, [f64; 2]) {
    let mut documents = done.documents.iter();
    let report = documents.find(|d| d.get("values").is_some()).unwrap();
    let values = report["values"].as_array().unwrap();
    let found = values.iter().find(|v| v["name"] == name).unwrap();
    let end = |i: usize| found["interval"][i].as_f64().unwrap_or(f64::NAN);
    (
        found["value"].as_f64().unwrap_or(f64::NAN),
        [end(0), end(1)],
    )
}

/// All figures and reports.
pub(crate) fn text(done: &Done) -> String {
    done.documents.iter().map(ToString::to_string).collect()
}
