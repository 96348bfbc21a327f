//! Recipes: any text parses or is refused with places inside the text.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Err(problems) = puncta_engine::recipe::parse(text) {
        assert!(!problems.is_empty());
        let lines = u32::try_from(text.lines().count().max(1) + 1).unwrap_or(u32::MAX);
        assert!(problems.iter().all(|problem| problem.place.line <= lines));
    }
});
