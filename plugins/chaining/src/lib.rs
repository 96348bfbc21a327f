//! Chains the repeats of one molecule across frames and merges them.
//!
//! [`chain`] holds the rule, [`window`] the search for chains near a localisation, [`merged`] how
//! the localisations of a chain become one. The other modules are the operations.

pub mod chain;
pub mod columns;
pub mod compatible;
pub mod estimate;
pub mod find;
pub mod merge;
pub mod merged;

pub mod pairs;
pub mod spots;
#[cfg(test)]
mod testing;
pub mod window;

puncta_sdk::plugin! {
    id: "puncta.chaining",
    title: "Repeats",
    description: "Chains the repeats of one molecule across frames and merges them.",
    isolation: "none",
    reentrant: true
}
