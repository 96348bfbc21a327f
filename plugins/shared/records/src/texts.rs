//! Texts into a column of the host.

use puncta_sdk::Failure;
use puncta_sdk::output::TextsMut;

/// Texts one after the other.
#[derive(Clone, Debug, Default)]
pub struct Texts {
    /// Where each ends.
    pub ends: Vec<u64>,
    /// UTF-8.
    pub bytes: Vec<u8>,
}

impl Texts {
    /// Adds a text.
    pub fn push(&mut self, text: &str) {
        self.bytes.extend_from_slice(text.as_bytes());
        self.ends.push(self.bytes.len() as u64);
    }

    /// Writes all into a column of as many rows (or of as many entries).
    ///
    /// # Errors
    /// When they do not fit the room that was planned.
    pub fn write(&self, room: TextsMut<'_>) -> Result<(), Failure> {
        let broken = || Failure::internal("texts do not fit the room that was planned");
        let (first, ends) = room.offsets.split_first_mut().ok_or_else(broken)?;
        let ends = ends.get_mut(..self.ends.len()).ok_or_else(broken)?;
        let bytes = room.bytes.get_mut(..self.bytes.len()).ok_or_else(broken)?;
        *first = 0;
        ends.copy_from_slice(&self.ends);
        bytes.copy_from_slice(&self.bytes);
        Ok(())
    }
}
