//! The shape of a characterization log: named tests of rows of numbers beside a few settings.
//!
//! Rows go into the log while the text is read, so that a file cut short still gives the rows before the cut.

use std::fmt;
use std::io::Read;

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::Value;
use wheelwright_core::recording::ReadError;

/// Settings that stand beside the tests.
const SETTINGS: [&str; 4] = ["sysid", "test", "units", "unitsPerRotation"];

/// One named test.
#[derive(Debug, Default)]
pub(super) struct Test {
    pub(super) name: String,
    pub(super) rows: Vec<Vec<f64>>,
}

/// A whole file.
#[derive(Debug, Default)]
pub(super) struct Log {
    settings: Vec<(String, Value)>,
    pub(super) tests: Vec<Test>,
    /// Where the file was cut, if it was.
    pub(super) cut: Option<String>,
}

impl Log {
    /// Reads a file.
    pub(super) fn read(input: impl Read) -> Result<Self, ReadError> {
        let mut log = Self::default();
        let mut json = serde_json::Deserializer::from_reader(input);
        let result = json.deserialize_any(Document(&mut log)).and_then(|()| json.end());
        let Err(error) = result else { return Ok(log) };
        let position = format!("line {}, column {}", error.line(), error.column());
        if error.is_eof() && !log.tests.is_empty() {
            log.cut = Some(position);
            return Ok(log);
        }
        let text = error.to_string();
        let reason = text.split(" at line ").next().unwrap_or(&text);
        Err(ReadError::Malformed { position, reason: format!("{reason}; repair or export the file again") })
    }

    /// A setting's value.
    pub(super) fn setting(&self, name: &str) -> Option<&Value> {
        self.settings.iter().find(|(key, _)| key == name).map(|(_, value)| value)
    }
}

struct Document<'a>(&'a mut Log);

impl<'de> Visitor<'de> for Document<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an object of tests such as \"slow-forward\", not bare rows, whose test and columns would be a guess")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(name) = map.next_key::<String>()? {
            if SETTINGS.contains(&name.as_str()) {
                let value = map.next_value()?;
                self.0.settings.push((name, value));
                continue;
            }
            self.0.tests.push(Test { name, rows: Vec::new() });
            if let Some(test) = self.0.tests.last_mut() {
                map.next_value_seed(Rows(&mut test.rows))?;
            }
        }
        Ok(())
    }
}

/// The rows of one test; values of other shapes are passed over.
struct Rows<'a>(&'a mut Vec<Vec<f64>>);

impl<'de> DeserializeSeed<'de> for Rows<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Rows<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("rows of numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        while let Some(row) = rows.next_element()? {
            self.0.push(row);
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }
}
