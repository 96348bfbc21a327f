//! What the tests of the operations share.

use puncta_testkit::Done;
pub(crate) use puncta_testkit::Random;

/// A value of the report.
pub(crate) fn value(done: &Done, name: &str) -> f64 {
    done.value(name).unwrap()
}
