//! The figure that the examples write.

use crate::histogram::Histogram;
use puncta_sdk::Operation;
use puncta_sdk::documents::Map;
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::serde_json::json;

/// A histogram of simulated localisations.
pub fn figure() -> Step {
    let table = Step {
        op: "puncta.synthetic.membrane/1".into(),
        ..Step::default()
    };
    let parameters = [("column", json!("x")), ("bins", json!(40))];
    let parameters: Map = parameters
        .map(|(name, value)| (name.into(), value))
        .into_iter()
        .collect();
    Step {
        op: Histogram::ID.into(),
        parameters,
        output: Some("figure".into()),
        inputs: [("table".into(), table)].into(),
    }
}
