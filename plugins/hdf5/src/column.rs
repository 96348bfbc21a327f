//! Where column values go: typed slices of the caller, cut into blocks of rows.

use puncta_sdk::Element;

/// Texts of one column: text `i` is `bytes[ends[i - 1]..ends[i]]`, the first starts at 0.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct TextColumn {
    pub(crate) ends: Vec<u64>,
    /// UTF-8.
    pub(crate) bytes: Vec<u8>,
}

impl TextColumn {
    pub(crate) fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Text of row `row`.
    pub(crate) fn get(&self, row: usize) -> Option<&str> {
        let end = usize::try_from(*self.ends.get(row)?).ok()?;
        let start = match row.checked_sub(1) {
            Some(before) => usize::try_from(*self.ends.get(before)?).ok()?,
            None => 0,
        };
        std::str::from_utf8(self.bytes.get(start..end)?).ok()
    }

    pub(crate) fn push(&mut self, text: &str) {
        self.bytes.extend_from_slice(text.as_bytes());
        self.ends.push(self.bytes.len() as u64);
    }

    /// Appends the rows of `other`.
    pub(crate) fn append(&mut self, other: &Self) {
        let base = self.bytes.len() as u64;
        self.bytes.extend_from_slice(&other.bytes);
        self.ends.extend(other.ends.iter().map(|end| base + end));
    }
}

macro_rules! column_mut {
    ($($kind:ident $type:ty),*) => {
        /// A column's memory: one element a row. `Bool` holds 0 or 1.
        #[derive(Debug)]
        pub(crate) enum ColumnMut<'a> {
            $($kind(&'a mut [$type]),)*
            Utf8(&'a mut TextColumn),
        }

        /// The part of a column that one block of rows fills.
        #[derive(Debug)]
        pub(crate) enum Part<'a> {
            $($kind(&'a mut [$type]),)*
            Utf8(TextColumn),
        }

        impl ColumnMut<'_> {
            /// Element type.
            pub(crate) fn element(&self) -> Element {
                match self {
                    $(Self::$kind(_) => Element::$kind,)*
                    Self::Utf8(_) => Element::Utf8,
                }
            }

            /// Rows that fit; a text column grows and has no bound.
            pub(crate) fn rows(&self) -> Option<usize> {
                match self {
                    $(Self::$kind(values) => Some(values.len()),)*
                    Self::Utf8(_) => None,
                }
            }

            /// Cuts the column into parts of `rows` rows, `count` parts in all.
            pub(crate) fn parts(&mut self, rows: usize, count: usize) -> Vec<Part<'_>> {
                match self {
                    $(Self::$kind(values) => values.chunks_mut(rows.max(1)).map(Part::$kind).collect(),)*
                    Self::Utf8(_) => (0..count).map(|_| Part::Utf8(TextColumn::default())).collect(),
                }
            }

            /// Puts row `order[i]` at row `i`.
            pub(crate) fn permute(&mut self, order: &[u32]) {
                match self {
                    $(Self::$kind(values) => {
                        let old = values.to_vec();
                        for (value, &row) in values.iter_mut().zip(order) {
                            if let Some(&from) = old.get(row as usize) {
                                *value = from;
                            }
                        }
                    })*
                    Self::Utf8(texts) => {
                        let mut sorted = TextColumn::default();
                        for &row in order {
                            sorted.push(texts.get(row as usize).unwrap_or_default());
                        }
                        **texts = sorted;
                    }
                }
            }
        }

        impl Part<'_> {
            /// The same part from row `start` on, `count` rows at most; texts are appended to.
            pub(crate) fn rows_mut(&mut self, start: usize, count: usize) -> PartRows<'_> {
                match self {
                    $(Self::$kind(values) => {
                        let end = start.saturating_add(count).min(values.len());
                        PartRows::$kind(values.get_mut(start..end).unwrap_or_default())
                    })*
                    Self::Utf8(texts) => PartRows::Utf8(texts, count),
                }
            }
        }

        /// Rows of a part that are filled together.
        #[derive(Debug)]
        pub(crate) enum PartRows<'a> {
            $($kind(&'a mut [$type]),)*
            Utf8(&'a mut TextColumn, usize),
        }
    };
}

column_mut!(
    U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64, F32 f32, F64 f64, Bool u8
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permute_moves_numbers_and_texts_alike() {
        let mut numbers = [10_i32, 11, 12];
        ColumnMut::I32(&mut numbers).permute(&[2, 0, 1]);
        assert_eq!(numbers, [12, 10, 11]);
        let mut texts = TextColumn::default();
        ["a", "", "ccc"].iter().for_each(|text| texts.push(text));
        ColumnMut::Utf8(&mut texts).permute(&[2, 0, 1]);
        assert_eq!(
            (texts.get(0), texts.get(1), texts.get(2)),
            (Some("ccc"), Some("a"), Some(""))
        );
        assert_eq!(texts.get(3), None);
    }

    #[test]
    fn parts_cover_all_rows_once() {
        let mut values = [0_u8; 10];
        let mut column = ColumnMut::U8(&mut values);
        let sizes: Vec<_> = column
            .parts(4, 3)
            .iter_mut()
            .map(|part| match part.rows_mut(0, 99) {
                PartRows::U8(rows) => rows.len(),
                _ => 0,
            })
            .collect();
        assert_eq!(sizes, [4, 4, 2]);
    }
}
