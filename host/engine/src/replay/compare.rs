//! Comparing the values of two objects where their files differ.

use crate::store::gather::scaled;
use crate::store::{ColumnData, Object};
use puncta_documents::{ColumnInfo, Failure, Kind};

/// How far the columns of two objects are from one another.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Values that were compared.
    pub values: u64,
    /// Values that are not the same.
    pub different: u64,
    /// The largest difference, as a share of the largest magnitude of its column.
    pub largest: f64,
    /// The column that has it.
    pub column: String,
}

impl Comparison {
    /// Whether all values are within a tolerance.
    #[must_use]
    pub fn within(&self, tolerance: f64) -> bool {
        self.largest <= tolerance
    }
}

/// Compares two objects value by value.
///
/// # Errors
/// When they are not of one kind, shape and columns: what differs.
pub fn compare(was: &Object, now: &Object) -> Result<Comparison, Failure> {
    let (old, new) = (was.header(), now.header());
    let other = |what: &str, a: &str, b: &str| {
        Err(Failure::bad_input(format!(
            "the {what} was {a} and is {b} now"
        )))
    };
    if old.kind != new.kind {
        return other("kind", &old.kind.to_string(), &new.kind.to_string());
    }
    if matches!(old.kind, Kind::Figure | Kind::Report) && old.document != new.document {
        return Err(Failure::bad_input("the document has other content"));
    }
    let mut comparison = Comparison::default();
    if old.parts.len() != new.parts.len() {
        return other(
            "number of parts",
            &old.parts.len().to_string(),
            &new.parts.len().to_string(),
        );
    }
    for (part, (a, b)) in old.parts.iter().zip(&new.parts).enumerate() {
        if a.rows != b.rows {
            return other("number of rows", &a.rows.to_string(), &b.rows.to_string());
        }
        let names = |columns: &[ColumnInfo]| {
            let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
            names.join(", ")
        };
        if names(&a.columns) != names(&b.columns) {
            return other("list of columns", &names(&a.columns), &names(&b.columns));
        }
        let pairs = was.columns(part).iter().zip(now.columns(part));
        for (info, (old, new)) in a.columns.iter().zip(pairs) {
            comparison.add(&info.name, old.column()?, new.column()?)?;
        }
    }
    Ok(comparison)
}

impl Comparison {
    fn add(&mut self, name: &str, was: &ColumnData, now: &ColumnData) -> Result<(), Failure> {
        self.values += was.rows * u64::from(was.type_.width);
        if bytes(was) == bytes(now) {
            return Ok(());
        }
        if was.type_.element.is_text() || was.type_ != now.type_ {
            // Texts are the same or they are not.
            self.different += was.rows;
            self.worse(name, f64::INFINITY);
            return Ok(());
        }
        let (was, now) = (scaled(was, 1.0)?, scaled(now, 1.0)?);
        let (Some(was), Some(now)) = (&was.data, &now.data) else {
            return Ok(());
        };
        let (was, now) = (was.slice::<f64>(), now.slice::<f64>());
        let finite = was.iter().filter(|value| value.is_finite());
        let magnitude = finite.fold(0.0_f64, |most, value| most.max(value.abs()));
        let mut largest = 0.0_f64;
        for (a, b) in was.iter().zip(now) {
            if a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()) {
                continue;
            }
            self.different += 1;
            let off = (a - b).abs() / magnitude;
            largest = largest.max(if off.is_finite() { off } else { f64::INFINITY });
        }
        self.worse(name, largest);
        Ok(())
    }

    fn worse(&mut self, name: &str, largest: f64) {
        if largest > self.largest {
            self.largest = largest;
            name.clone_into(&mut self.column);
        }
    }
}

fn bytes(column: &ColumnData) -> [Option<&[u8]>; 3] {
    [&column.data, &column.offsets, &column.text]
        .map(|region| region.as_ref().map(|region| region.slice::<u8>()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Stored;
    use crate::store::gather::numbers;
    use puncta_documents::{Element, Header};

    fn table(columns: &[(&str, &[f64])]) -> Object {
        let info = |(name, _): &(&str, &[f64])| ColumnInfo::new(*name, Element::F64, "nm");
        let rows = columns[0].1.len() as u64;
        let header = Header::table("t", rows, columns.iter().map(info).collect());
        let stored = columns
            .iter()
            .map(|(_, values)| Stored::whole(numbers(values)));
        Object::new(header, vec![stored.collect()]).unwrap()
    }

    #[test]
    fn equal_tables_differ_by_nothing() {
        let one = table(&[("x", &[1.0, f64::NAN, 3.0])]);
        let found = compare(&one, &table(&[("x", &[1.0, f64::NAN, 3.0])])).unwrap();
        assert_eq!((found.values, found.different), (3, 0));
        assert!(found.within(0.0));
    }

    #[test]
    fn the_largest_difference_is_a_share_of_the_columns_magnitude() {
        let was = table(&[("x", &[1.0, -200.0]), ("y", &[4.0, 8.0])]);
        let now = table(&[("x", &[1.0, -200.5]), ("y", &[4.5, 8.0])]);
        let found = compare(&was, &now).unwrap();
        assert_eq!((found.values, found.different), (4, 2));
        assert_eq!((found.largest, &*found.column), (0.0625, "y"));
        assert!(found.within(0.07) && !found.within(0.06));
        // A value that is missing only once is no rounding.
        let gone = table(&[("x", &[1.0, f64::NAN]), ("y", &[4.0, 8.0])]);
        assert!(!compare(&was, &gone).unwrap().within(1e9));
    }

    #[test]
    fn another_shape_is_named() {
        let was = table(&[("x", &[1.0, 2.0])]);
        let text = |now| compare(&was, &now).unwrap_err().to_string();
        assert!(text(table(&[("x", &[1.0])])).contains("number of rows was 2 and is 1"));
        assert!(text(table(&[("y", &[1.0, 2.0])])).contains("list of columns was x and is y"));
        let image = Object::document(Kind::Report, "r", serde_json::json!({}));
        assert!(text(image).contains("kind was table and is report"));
    }
}
