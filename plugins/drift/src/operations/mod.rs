//! The operations of this plugin.

pub mod entropy;

/// Sentences that the descriptions share.
pub const CONVENTION: &str = "The drift is how far the sample has moved; it is subtracted from the positions. Rows without \
     a finite position and time are passed through. The times need not be sorted and may have gaps.";
