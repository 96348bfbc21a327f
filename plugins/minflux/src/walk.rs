//! A walk through a list of JSON objects, value by value.

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::cell::RefCell;
use std::fmt;

/// What is done with each row.
pub trait Take {
    /// A value of the current row. `axis` counts in a list.
    fn value(&mut self, key: &str, axis: Option<usize>, value: f64);
    /// The row has ended. A message stops the reading.
    fn end(&mut self) -> Result<(), String>;
}

/// A list of localisations.
pub struct Rows<'t, T>(pub &'t RefCell<T>);
struct Row<'t, T>(&'t RefCell<T>);
struct Values<'t, T> {
    take: &'t RefCell<T>,
    key: &'t str,
    axis: Option<usize>,
}

impl<'de, T: Take> DeserializeSeed<'de> for Rows<'_, T> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_seq(self)
    }
}

impl<'de, T: Take> Visitor<'de> for Rows<'_, T> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of localisations")
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        while rows.next_element_seed(Row(self.0))?.is_some() {
            self.0
                .borrow_mut()
                .end()
                .map_err(serde::de::Error::custom)?;
        }
        Ok(())
    }
}

impl<'de, T: Take> DeserializeSeed<'de> for Row<'_, T> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_map(self)
    }
}

/// Three letters, as all of MINFLUX's names are, need no memory of their own.
enum Name {
    Short([u8; 3]),
    Long(String),
}

impl Name {
    fn text(&self) -> &str {
        match self {
            Name::Short(bytes) => std::str::from_utf8(bytes).unwrap_or(""),
            Name::Long(text) => text,
        }
    }
}

struct NameSeed;

impl<'de> DeserializeSeed<'de> for NameSeed {
    type Value = Name;
    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<Name, D::Error> {
        from.deserialize_str(self)
    }
}

impl Visitor<'_> for NameSeed {
    type Value = Name;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name")
    }
    fn visit_str<E>(self, text: &str) -> Result<Name, E> {
        Ok(match text.as_bytes().try_into() {
            Ok(short) => Name::Short(short),
            Err(_) => Name::Long(text.to_owned()),
        })
    }
}

impl<'de, T: Take> Visitor<'de> for Row<'_, T> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a localisation")
    }
    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<(), A::Error> {
        while let Some(name) = members.next_key_seed(NameSeed)? {
            let values = Values {
                take: self.0,
                key: name.text(),
                axis: None,
            };
            members.next_value_seed(values)?;
        }
        Ok(())
    }
}

impl<'de, T: Take> DeserializeSeed<'de> for Values<'_, T> {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_any(self)
    }
}

impl<T: Take> Values<'_, T> {
    fn give<E>(self, value: f64) -> Result<(), E> {
        self.take.borrow_mut().value(self.key, self.axis, value);
        Ok(())
    }
}

#[allow(clippy::cast_precision_loss)]
impl<'de, T: Take> Visitor<'de> for Values<'_, T> {
    type Value = ();
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }
    fn visit_f64<E>(self, value: f64) -> Result<(), E> {
        self.give(value)
    }
    fn visit_u64<E>(self, value: u64) -> Result<(), E> {
        self.give(value as f64)
    }
    fn visit_i64<E>(self, value: i64) -> Result<(), E> {
        self.give(value as f64)
    }
    fn visit_bool<E>(self, value: bool) -> Result<(), E> {
        self.give(f64::from(u8::from(value)))
    }
    fn visit_unit<E>(self) -> Result<(), E> {
        self.give(f64::NAN)
    }
    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        for axis in 0.. {
            if self.axis.is_some() || axis >= 64 {
                while list.next_element::<IgnoredAny>()?.is_some() {}
                return Ok(());
            }
            let inner = Values {
                take: self.take,
                key: self.key,
                axis: Some(axis),
            };
            if list.next_element_seed(inner)?.is_none() {
                return Ok(());
            }
        }
        Ok(())
    }
    fn visit_map<A: MapAccess<'de>>(self, members: A) -> Result<(), A::Error> {
        if self.key == "itr" {
            // The list of a localisation's iterations: the last one stands.
            return Row(self.take).visit_map(members);
        }
        let mut members = members;
        while members.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(())
    }
}
