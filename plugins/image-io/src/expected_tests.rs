//! Real files against what tifffile and NumPy read in them (`tests/expected`).

use crate::{NpyRead, TiffRead};
use puncta_sdk::Element;
use puncta_sdk::serde_json::{self, Value};
use puncta_testkit::{Call, Object};
use std::path::Path;

fn values(image: &Object) -> Vec<f64> {
    match image.header.parts[0].columns[0].type_.element {
        Element::F32 => {
            let values = image.f32("value").unwrap();
            values.into_iter().map(f64::from).collect()
        }
        Element::U16 => {
            let values = image.numbers(0, "value", Element::U16, u16::from_ne_bytes);
            values.unwrap().into_iter().map(f64::from).collect()
        }
        Element::U8 => {
            let values = image.numbers(0, "value", Element::U8, u8::from_ne_bytes);
            values.unwrap().into_iter().map(f64::from).collect()
        }
        other => panic!("{}", other.name()),
    }
}

#[test]
fn images_hold_what_other_programs_read() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("tests/expected/images.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    for file in expected["files"].as_array().unwrap() {
        let name = file["file"].as_str().unwrap();
        let path = root.join("../shared/data").join(name);
        // The data are no part of the repository.
        if !path.exists() {
            continue;
        }
        let done = match name.ends_with(".npy") {
            true => Call::of::<NpyRead>().file(&path).run(),
            false => Call::of::<TiffRead>().file(&path).run(),
        };
        let done = done.unwrap_or_else(|e| panic!("{name}: {e}"));
        let image = done.output("image").unwrap();
        let object = &file["objects"][0];
        let size: Vec<u64> = object["size"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(Value::as_u64)
            .collect();
        assert_eq!(image.header.image.as_ref().unwrap().size, *size, "{name}");
        let column = &object["columns"][0];
        let element = image.header.parts[0].columns[0].type_.element;
        assert_eq!(column["type"], element.name(), "{name}");
        let found = values(image);
        let number = |key: &str| column[key].as_f64().unwrap();
        let low = found.iter().copied().fold(f64::INFINITY, f64::min);
        let high = found.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert_eq!((low, high), (number("min"), number("max")), "{name}");
        let slack = found.len() as f64 * f64::EPSILON * number("sum_abs");
        let sum: f64 = found.iter().sum();
        assert!((sum - number("sum")).abs() <= slack, "{name}: {sum}");
    }
}
