//! The operations of this plugin.

pub mod random;
pub mod range;
pub mod rectangle;

use puncta_sdk::prelude::*;

use crate::mask::Mask;

/// Gives the rows of the mask as the selection `table`.
fn select(job: &Job, mask: &Mask) -> Result<(), Failure> {
    let rows = mask.count() as u64;
    let mut out = job.select("table")?;
    out.commit(0, rows)?;
    let slots = out.u32_mut("row")?.get_mut(..mask.count());
    let slots = slots.ok_or_else(|| Failure::internal("the selection has too little room"))?;
    mask.write(slots, job)?;
    out.finish_rows(&[rows])
}

/// Working memory of a selection: one bit a row.
fn memory(request: &Request) -> u64 {
    let rows = request
        .inputs
        .first()
        .map_or(0, |input| input.header.rows());
    rows / 8 + (1 << 16)
}
