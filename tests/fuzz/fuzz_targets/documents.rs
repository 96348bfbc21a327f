//! Control documents: whatever a plugin says, reading it neither panics nor loses what it keeps.
#![no_main]

use libfuzzer_sys::fuzz_target;
use puncta_documents::{Header, Manifest, Output, Plan, Unit, call, header, manifest, schema, units};

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(document) = puncta_documents::parse::<Manifest>(text, manifest::PLUGIN) {
        for operation in &document.operations {
            let _ = schema::canonical(&operation.parameters, &puncta_documents::Map::new());
        }
    }
    let _ = puncta_documents::parse::<Plan>(text, call::PLAN);
    let _ = puncta_documents::parse::<Output>(text, call::OUTPUT);
    if let Ok(document) = puncta_documents::parse::<Header>(text, header::HEADER) {
        let again = puncta_documents::write(&document, header::HEADER);
        assert_eq!(puncta_documents::parse::<Header>(&again, header::HEADER), Ok(document));
    }
    if let Some(unit) = Unit::parse(text) {
        let _ = units::conversion(text, &unit.to_string());
    }
    let _ = units::quantity(text, "nm");
});
