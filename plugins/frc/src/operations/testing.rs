//! What the tests of the operations share.

use puncta_testkit::Done;
pub(crate) use puncta_testkit::Random;

/// A value of the report.
pub(crate) fn value(done: &Done, name: &str) -> f64 {
    let mut documents = done.documents.iter();
    let report = documents.find(|d| d.get("values").is_some()).unwrap();
    let values = report["values"].as_array().unwrap();
    let found = values.iter().find(|v| v["name"] == name).unwrap();
    found["value"].as_f64().unwrap_or(f64::NAN)
}

/// All figures and reports.
pub(crate) fn text(done: &Done) -> String {
    done.documents.iter().map(ToString::to_string).collect()
}
