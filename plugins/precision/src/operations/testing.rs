//! What the tests of the operations share.

use puncta_testkit::Done;
pub(crate) use puncta_testkit::Random;

/// A value of the report, and its interval.
pub(crate) fn value(done: &Done, name: &str) -> (f64, [f64; 2]) {
    let entry = done.reported(name).unwrap();
    let end = |i: usize| entry["interval"][i].as_f64().unwrap_or(f64::NAN);
    (done.value(name).unwrap(), [end(0), end(1)])
}
