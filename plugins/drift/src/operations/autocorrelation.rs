//! `puncta.drift.autocorrelation/1`

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::CONVENTION;
use super::correlated::{Correlated, example};
use crate::coarse::Pattern;
use crate::correction::{input, outputs, plan};

/// Correct drift by autocorrelation.
#[derive(Params)]
pub struct Autocorrelation {
    #[param(flatten)]
    correlated: Correlated,
}

impl Operation for Autocorrelation {
    const ID: &'static str = "puncta.drift.autocorrelation/1";

    fn info() -> Info {
        let info = Info::operation("Correct drift by autocorrelation")
            .description(&format!(
                "Correlates each time segment with the first one.\nSimple, and less precise than the redundant correlation, as every error of the first segment goes into all others. The same on two halves of the field gives the error. {CONVENTION}"
            ))
            .input(input());
        example(outputs(info).cite("Z. R. Connerty-Marin, Quantifying Membrane Topology at the Nanoscale, PhD thesis, Yale University, 2022, appendix B"), json!({ "precision": 5 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.correlated.axes)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.correlated
            .correct(job, Pattern::First, "Correlation with the first of")
    }
}

puncta_sdk::register!(Autocorrelation);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Sample, drift_error};
    use puncta_testkit::Call;

    #[test]
    fn a_smooth_drift_is_found() {
        for three in [false, true] {
            let mut sample = Sample::new(3);
            sample.three = three;
            let run = |threads| {
                let call = Call::of::<Autocorrelation>().input("table", sample.table());
                call.threads(threads).run().unwrap()
            };
            let one = run(1);
            let error = drift_error(&one, &sample);
            // A quarter of the cells of two precisions: each pair errs as in the redundant
            // correlation, but nothing averages over the pairs.
            assert!(error < 5.0, "{error}");
            assert_eq!(one.documents, run(3).documents);
        }
    }
    #[test]
    fn sparse_tables_get_longer_segments() {
        for seed in 50..55 {
            let steady = |t: f64| [0.06 * t, -0.04 * t, 0.0];
            let sample = Sample::with(seed, steady).thinned(10);
            let call = || Call::of::<Autocorrelation>().input("table", sample.table());
            let done = call().run().unwrap();
            let error = drift_error(&done, &sample);
            assert!(error < 5.0, "{error}");
            assert!(done.value("segments").unwrap() <= 6.0);
            let short = call().set("segment", 50).run().unwrap_err().to_string();
            assert!(short.contains("no structure"), "{short}");
        }
    }
}
