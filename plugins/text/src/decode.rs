//! What DECODE's csv says of its unit in the JSON lines above the header.

use crate::flavours::Flavour;
use puncta_sdk::serde_json::{self, Value};

/// The unit of x and y, and the camera pixel along x and y in nm.
pub fn lateral(flavour: Flavour, comments: &[String]) -> (Option<String>, Option<[f64; 2]>) {
    if flavour != Flavour::Decode {
        return (None, None);
    }
    let mut unit = None;
    let mut pixel = None;
    for comment in comments.iter().filter(|c| c.starts_with('{')) {
        let Ok(Value::Object(meta)) = serde_json::from_str(comment) else {
            continue;
        };
        let meta = meta.get("meta").and_then(Value::as_object).unwrap_or(&meta);
        if let Some(text) = meta.get("xy_unit").and_then(Value::as_str) {
            unit = Some(text.to_owned());
        }
        let size = |at: usize| {
            let value = meta.get("px_size")?.get(at)?.as_f64()?;
            (value.is_finite() && value > 0.0).then_some(value)
        };
        if let (Some(x), Some(y)) = (size(0), size(1)) {
            pixel = Some([x, y]);
        }
    }
    (unit, pixel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_json_says_unit_and_pixel() {
        let lines = |text: &str| vec!["DECODE EmitterSet".to_owned(), text.to_owned()];
        let (unit, pixel) = lateral(
            Flavour::Decode,
            &lines(r#"{"xy_unit": "px", "px_size": [127.0, 117.0]}"#),
        );
        assert_eq!((unit.as_deref(), pixel), (Some("px"), Some([127.0, 117.0])));
        for odd in [
            r#"{"xy_unit": null, "px_size": [0, 1]}"#,
            "{\"xy_unit\": ",
            "[[[",
            "{}",
        ] {
            assert_eq!(lateral(Flavour::Decode, &lines(odd)), (None, None), "{odd}");
        }
    }
}
