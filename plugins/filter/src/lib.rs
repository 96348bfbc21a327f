//! Filters: selections of table rows by value ranges, by a rectangle, at random.
//!
//! Every filter gives strictly increasing row numbers, so that no column is copied. The bits of the
//! rows are set in parallel blocks that read each column once; see [`mask`].

pub mod mask;
pub mod operations;
pub mod range;
pub mod rectangle;
pub mod subset;

puncta_sdk::plugin! {
    id: "puncta.filter",
    title: "Filters",
    description: "Keeps rows of a table: by limits of columns, inside a rectangle, or at random.",
    isolation: "none",
    reentrant: true,
}
