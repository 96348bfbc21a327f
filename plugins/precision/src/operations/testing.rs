//! What the tests of the operations share.

use puncta_testkit::Done;

/// Random numbers from a seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}

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
