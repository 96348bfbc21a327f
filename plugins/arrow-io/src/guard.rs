//! The decoder's answers as sentences, also where it gives up in another way than by an error.

use puncta_sdk::Failure;
use puncta_shared_records::damaged;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Decodes a part of the file called `name`. What the decoder finds impossible is a damaged file,
/// whether it says so or panics.
pub fn decode<T, E: Display>(
    name: &str,
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, Failure> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => {
            let text = error.to_string();
            let line: String = text
                .lines()
                .next()
                .unwrap_or("")
                .chars()
                .take(160)
                .collect();
            Err(damaged(format!("{name} cannot be decoded: {line}")))
        }
        Err(_) => Err(damaged(format!("{name} cannot be decoded"))),
    }
}
