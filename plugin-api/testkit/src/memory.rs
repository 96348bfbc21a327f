//! Aligned memory for columns.

use puncta_sdk::abi;
use puncta_sdk::documents::{ColumnInfo, Element};

/// Memory of one column: u64 words, so that every element type is aligned.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    pub(crate) data: Vec<u64>,
    pub(crate) offsets: Vec<u64>,
    pub(crate) text: Vec<u8>,
    pub(crate) entries: u64,
}

impl Memory {
    /// Room for `rows` rows, filled with a pattern that is no plausible result.
    pub(crate) fn room(info: &ColumnInfo, rows: usize) -> Memory {
        let bytes = rows * info.type_.row_bytes();
        let texts = match info.type_.element {
            Element::Utf8 => rows + 1,
            Element::Dictionary => usize::try_from(info.entries.unwrap_or(0)).unwrap_or(0) + 1,
            _ => 0,
        };
        let room = info.text_bytes.unwrap_or(0);
        let text = if texts > 0 {
            usize::try_from(room).unwrap_or(0)
        } else {
            0
        };
        Memory {
            data: vec![0xdead_beef_dead_beef; bytes.div_ceil(8)],
            offsets: vec![0; texts],
            text: vec![b'?'; text],
            entries: info.entries.unwrap_or(0),
        }
    }

    /// Copies the old content into larger room.
    pub(crate) fn grown(&self, info: &ColumnInfo, rows: usize) -> Memory {
        let mut larger = Memory::room(info, rows);
        let words = self.data.len().min(larger.data.len());
        larger.data[..words].copy_from_slice(&self.data[..words]);
        let offsets = self.offsets.len().min(larger.offsets.len());
        larger.offsets[..offsets].copy_from_slice(&self.offsets[..offsets]);
        let text = self.text.len().min(larger.text.len());
        larger.text[..text].copy_from_slice(&self.text[..text]);
        larger
    }

    /// As the ABI shows it.
    pub(crate) fn column(&mut self, info: &ColumnInfo, rows: u64) -> abi::Column {
        abi::Column {
            data: self.data.as_mut_ptr().cast(),
            offsets: self.offsets.as_mut_ptr(),
            text: self.text.as_mut_ptr(),
            rows,
            entries: self.entries,
            text_bytes: self.text.len() as u64,
            kind: info.type_.element.code(),
            width: info.type_.width,
        }
    }

    /// Bytes of the numbers.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.data
            .iter()
            .flat_map(|word| word.to_ne_bytes())
            .collect()
    }
}
