//! Which program wrote a file.

use super::{Head, Names, has_number, without_mark};
use crate::encoding;
use crate::flavours::{Flavour, recognise};
use crate::headerless;
use crate::options::Delimiter;
use crate::rapidstorm;
use crate::record::{self, Line};
use puncta_sdk::Failure;

impl Head<'_> {
    /// The kind of file, and whether only its values say so. `from_hash`: the names are those of
    /// the last comment; `nameless`: there are none.
    pub(super) fn kind(
        &self,
        names: &[String],
        comments: &[String],
        (from_hash, nameless): (bool, bool),
        delimiter: Delimiter,
    ) -> (Flavour, bool) {
        match self.flavour(names, comments, from_hash) {
            named @ (Flavour::Auto | Flavour::Malk) if nameless => self.guess(named, delimiter),
            named => (named, false),
        }
    }

    /// The comments without their marks, and without the last one where it holds the names.
    pub(super) fn comments(&self, without_last: bool) -> Vec<String> {
        let text = |c: &&[u8]| encoding::text(without_mark(c)).trim().to_owned();
        let mut comments: Vec<String> = self.comments.iter().map(text).collect();
        if without_last {
            comments.pop();
        }
        comments
    }

    /// The kind by the person's word, or by names and comments.
    fn flavour(&self, names: &[String], comments: &[String], from_hash: bool) -> Flavour {
        let rapid = |c: &String| c.as_bytes().starts_with(rapidstorm::START);
        match self.options.dialect {
            _ if comments.iter().any(rapid) => Flavour::Rapidstorm,
            Flavour::Auto => recognise(names, comments, from_hash),
            said => said,
        }
    }

    /// The kind of a table without names, and whether only its values say so.
    fn guess(&self, named: Flavour, delimiter: Delimiter) -> (Flavour, bool) {
        let number = |f: &record::Field<'_>| -> f64 {
            let text = std::str::from_utf8(&f.text).ok();
            text.and_then(|t| t.parse().ok()).unwrap_or(f64::NAN)
        };
        let row = |l: &Line<'_>| -> Vec<f64> {
            record::split(l.text, delimiter)
                .iter()
                .map(number)
                .collect()
        };
        let lines = std::iter::once(&self.first).chain(&self.rest);
        let rows: Vec<Vec<f64>> = lines.map(row).collect();
        let found = headerless::guess(named, self.file, &rows);
        (found.flavour, found.assumed)
    }

    /// The names in the XML line of rapidSTORM.
    pub(super) fn rapidstorm(&self) -> Result<Option<Names>, Failure> {
        let mut lines = self.comments.iter().map(|c| without_mark(c));
        let Some(line) = lines.find(|c| c.starts_with(rapidstorm::START)) else {
            return Ok(None);
        };
        Ok(Some(Names {
            names: rapidstorm::fields(line, self.file)?.names(),
            delimiter: Delimiter::Blanks,
            is_data: true,
            from_hash: false,
        }))
    }

    /// Takes units such as `(micron)` from the lines below the names; how many lines there are.
    pub(super) fn units_below(&self, names: &mut [String], delimiter: Delimiter) -> usize {
        let words = |l: &&Line<'_>| !has_number(l, delimiter);
        let above: Vec<&Line<'_>> = self.rest.iter().take(3).take_while(words).collect();
        for line in &above {
            for (name, field) in names.iter_mut().zip(record::split(line.text, delimiter)) {
                let text = encoding::text(&field.text);
                let unit = text
                    .trim()
                    .strip_prefix('(')
                    .and_then(|t| t.strip_suffix(')'));
                if let Some(unit) = unit.filter(|_| !name.ends_with(']')) {
                    name.push_str(&format!(" [{unit}]"));
                }
            }
        }
        above.len()
    }
}
