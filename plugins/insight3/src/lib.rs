//! Insight3 molecule lists (`.bin`).

mod reader;
#[cfg(test)]
mod tests;

pub use reader::ReadInsight3;

puncta_sdk::plugin! {
    id: "puncta.insight3",
    title: "Insight3 molecule lists",
    description: "Reads Insight3 molecule lists (.bin).",
    isolation: "none",
    reentrant: true,
}

puncta_sdk::register!(ReadInsight3);
