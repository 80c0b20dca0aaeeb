//! Where parameters come from: the query and JSON, as pairs for the one parser.

use super::ParameterSet;
use super::table::TABLE;
use crate::error::{EngineError, InputError};
use percent_encoding::percent_decode_str;
use serde::de::{self, Deserializer, IgnoredAny, MapAccess, Visitor};
use serde_json::value::RawValue;
use std::fmt;

impl ParameterSet {
    /// The parameters of a query: `name=value` pairs between `&`, percent-encoded; a plus sign is
    /// a plus sign.
    ///
    /// # Errors
    /// When the encoding is broken, and as [`ParameterSet::add`].
    pub fn of_query(query: Option<&str>) -> Result<Self, EngineError> {
        let mut set = Self::default();
        for pair in pairs_of_query(query) {
            let (name, value) = pair?;
            set.add(&name, &value)?;
        }
        Ok(set)
    }

    /// Adds the members of a flat JSON object: numbers, words and truth values.
    ///
    /// # Errors
    /// When the text is anything else, and as [`ParameterSet::add`].
    pub fn add_json(&mut self, text: &[u8]) -> Result<(), EngineError> {
        let pairs = pairs_of_json(text)?;
        pairs.iter().try_for_each(|(name, value)| self.add(name, value))
    }
}

/// The pairs of a name and a value in a query, percent-decoded.
///
/// # Errors
/// When the encoding is broken, at the pair that has it.
pub fn pairs_of_query(
    query: Option<&str>,
) -> impl Iterator<Item = Result<(String, String), InputError>> {
    let pairs = query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty());
    pairs.map(|pair| {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        Ok((percent_decoded(name)?, percent_decoded(value)?))
    })
}

/// Most members of a JSON object that are kept. No object that is understood has as many, so that one
/// of these is unknown or repeated; small as members may be, millions of them would not be.
pub const MOST_MEMBERS: usize = TABLE.len() + 1;

/// The members of a flat JSON object, each value as its text; of a longer one its first
/// [`MOST_MEMBERS`].
///
/// # Errors
/// When the text is anything else.
pub fn pairs_of_json(text: &[u8]) -> Result<Vec<(String, String)>, InputError> {
    let read = serde_json::from_slice(text);
    let Pairs(pairs) = read.map_err(|error| InputError::Json(error.to_string()))?;
    Ok(pairs)
}

/// Decodes `%41` and the like; broken escapes, broken UTF-8 and control characters are refused.
fn percent_decoded(text: &str) -> Result<String, InputError> {
    let is_digit = |digit: Option<&u8>| digit.is_some_and(u8::is_ascii_hexdigit);
    let bytes = text.as_bytes();
    let escapes = (0..bytes.len()).filter(|&start| bytes[start] == b'%');
    for start in escapes {
        if !(is_digit(bytes.get(start + 1)) && is_digit(bytes.get(start + 2))) {
            return Err(InputError::Query("a '%' without two hexadecimal digits after it"));
        }
    }
    let decoded = percent_decode_str(text)
        .decode_utf8()
        .map_err(|_| InputError::Query("escapes that are not UTF-8"))?;
    if decoded.chars().any(char::is_control) {
        return Err(InputError::Query("an escaped control character"));
    }
    Ok(decoded.into_owned())
}

/// The members of an object in their order, also repeated ones, each value as its text.
struct Pairs(Vec<(String, String)>);

impl<'de> de::Deserialize<'de> for Pairs {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(PairsVisitor)
    }
}

struct PairsVisitor;

impl<'de> Visitor<'de> for PairsVisitor {
    type Value = Pairs;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an object of numbers, strings, true and false")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Pairs, A::Error> {
        let mut pairs = Vec::new();
        while pairs.len() < MOST_MEMBERS {
            let member = members.next_entry::<String, &RawValue>()?;
            let Some((name, value)) = member else { return Ok(Pairs(pairs)) };
            pairs.push((name, text_of(value.get()).map_err(de::Error::custom)?));
        }
        skip_rest(members)?;
        Ok(Pairs(pairs))
    }
}

/// Reads the members that are left without keeping any.
///
/// # Errors
/// When the rest of the object cannot be read.
pub fn skip_rest<'de, A: MapAccess<'de>>(mut members: A) -> Result<(), A::Error> {
    while members.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
    Ok(())
}

/// The text of a JSON value that is a string, a number or a truth value.
fn text_of(json: &str) -> Result<String, serde_json::Error> {
    match json.as_bytes().first() {
        Some(b'"') => serde_json::from_str(json),
        Some(b't' | b'f') => Ok(json.to_owned()),
        _ => serde_json::from_str::<f64>(json).map(|_| json.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is wrong, in a word.
    fn defect(result: Result<(), EngineError>) -> &'static str {
        match result {
            Ok(()) => "",
            Err(EngineError::Input(InputError::Query(_))) => "query",
            Err(EngineError::Input(InputError::Json(_))) => "json",
            Err(EngineError::Input(InputError::Repeated(_))) => "repeated",
            Err(EngineError::Input(InputError::Unknown { .. })) => "unknown",
            Err(EngineError::Input(InputError::Malformed { .. })) => "malformed",
            Err(error) => panic!("{error}"),
        }
    }

    fn json(text: &[u8]) -> &'static str {
        defect(ParameterSet::default().add_json(text))
    }

    fn query(text: &str) -> &'static str {
        defect(ParameterSet::of_query(Some(text)).map(|_| ()))
    }

    #[test]
    fn a_flat_object_gives_the_same_as_a_query() {
        let mut set = ParameterSet::default();
        set.add_json(br#"{"density": 2.5, "method": "med", "leaky": true, "seed": 7}"#).unwrap();
        let from_query = ParameterSet::of_query(Some("density=2.5&method=med&leaky=true&seed=7"));
        let query = from_query.unwrap().finish().unwrap().query();
        assert_eq!(set.finish().unwrap().query(), query);
    }

    #[test]
    fn what_is_not_a_flat_object_is_refused() {
        let deep = [vec![b'['; 10_000], vec![b']'; 10_000]].concat();
        let nested = [b"{\"density\":".as_slice(), &deep, b"}"].concat();
        for text in [
            deep.as_slice(),
            nested.as_slice(),
            b"",
            b"[]",
            b"{\"density\": 1e400}",
            b"\xEF\xBB\xBF{}",
            b"{\"density\": 2,}",
            b"{} {}",
            b"{\"method\": \"\xFF\"}",
            b"{\"method\": \"\\ud800\"}",
            b"{\"density\": null}",
            b"{\"density\": {}}",
        ] {
            assert_eq!(json(text), "json", "{}", String::from_utf8_lossy(text));
        }
        assert_eq!(json(br#"{"density": 1, "density": 2}"#), "repeated");
        assert_eq!(json(br#"{"desnity": 1}"#), "unknown");
    }

    #[test]
    fn broken_escapes_are_refused_and_plus_is_no_space() {
        for text in
            ["density=%zz", "density=%", "density=%4", "density=%00", "density=%c0%af", "%ff=1"]
        {
            assert_eq!(query(text), "query", "{text}");
        }
        assert_eq!(query("density=+5"), "malformed");
        assert_eq!(query("density=%205"), "malformed");
        assert_eq!(query("density"), "malformed");
        assert_eq!(query("%64ensity=5&&"), "");
    }
}
