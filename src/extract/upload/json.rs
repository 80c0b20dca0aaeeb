//! Reads a JSON object: the files in base64, and the parameters as an object `params`.

use crate::problem::{Kind, Problem};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pixmesh_engine::InputError;
use pixmesh_engine::params::{MOST_MEMBERS, pairs_of_json, skip_rest, unknown};
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;
use std::borrow::Cow;
use std::fmt;

/// The files found, and the pairs of a name and a text among the parameters.
pub(super) type Found<const N: usize> = ([Option<Vec<u8>>; N], Vec<(String, String)>);

/// Reads the files of these names, and the parameters.
pub(super) fn read<const N: usize>(
    files: [&'static str; N],
    body: &[u8],
) -> Result<Found<N>, Problem> {
    let Members(members) = serde_json::from_slice(body).map_err(|error| malformed(&error))?;
    let (mut found, mut pairs) = ([const { None }; N], Vec::new());
    let mut seen: Vec<&str> = Vec::new();
    for (name, value) in &members {
        if seen.contains(&&**name) {
            return Err(InputError::Repeated((**name).to_owned()).into());
        }
        match files.iter().position(|file| *file == &**name) {
            Some(index) => found[index] = Some(decoded(files[index], value)?),
            None if name == "params" => pairs = pairs_of_json(value.get().as_bytes())?,
            None => {
                let known: Vec<&str> = files.into_iter().chain(["params"]).collect();
                return Err(unknown(name, &known).into());
            }
        }
        seen.push(name);
    }
    Ok((found, pairs))
}

/// The bytes of a file in base64, with its padding.
fn decoded(name: &'static str, value: &RawValue) -> Result<Vec<u8>, Problem> {
    let malformed = || {
        let detail = format!("{name} must be a string of base64 (RFC 4648, section 4, padded)");
        Problem::new(Kind::ParameterMalformed, detail).param(name)
    };
    let text: Text = serde_json::from_str(value.get()).map_err(|_| malformed())?;
    STANDARD.decode(text.0.as_bytes()).map_err(|_| malformed())
}

fn malformed(error: &serde_json::Error) -> Problem {
    Problem::new(Kind::JsonMalformed, format!("the body: {error}"))
}

/// A string that is only copied when it has escapes.
#[derive(Deserialize)]
struct Text<'a>(#[serde(borrow)] Cow<'a, str>);

/// The members of an object in their order, also repeated ones, but no more than
/// [`MOST_MEMBERS`].
struct Members<'a>(Vec<(String, &'a RawValue)>);

impl<'de> Deserialize<'de> for Members<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct MembersVisitor;
        impl<'de> Visitor<'de> for MembersVisitor {
            type Value = Members<'de>;
            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("an object with an image in base64 and params")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Members<'de>, A::Error> {
                let mut members = Vec::new();
                while members.len() < MOST_MEMBERS {
                    let Some(member) = map.next_entry()? else { return Ok(Members(members)) };
                    members.push(member);
                }
                skip_rest(map)?;
                Ok(Members(members))
            }
        }
        deserializer.deserialize_map(MembersVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(body: &[u8]) -> Result<Option<Vec<u8>>, Kind> {
        let found = read(["image"], body);
        found.map(|([image], _)| image).map_err(|problem| problem.kind())
    }

    #[test]
    fn files_are_base64_and_parameters_an_object() {
        assert_eq!(image(br#"{"image": "AQID", "params": {"size": 50}}"#), Ok(Some(vec![1, 2, 3])));
        assert_eq!(image(br#"{"image": "AQI\u003d"}"#), Ok(Some(vec![1, 2])));
        assert_eq!(image(b"{}"), Ok(None));
    }

    #[test]
    fn of_very_many_members_one_is_refused_and_the_rest_is_still_read() {
        let members = |count: usize| {
            (0..count).map(|n| format!("\"k{n}\": {{}}")).collect::<Vec<_>>().join(", ")
        };
        let body = |rest: &str| format!("{{{}{rest}", members(3 * MOST_MEMBERS));
        assert_eq!(image(body("}").as_bytes()), Err(Kind::UnknownParameter));
        assert_eq!(image(body("").as_bytes()), Err(Kind::JsonMalformed));
        assert_eq!(image(body(", 1}").as_bytes()), Err(Kind::JsonMalformed));
    }

    #[test]
    fn anything_else_is_refused() {
        let deep = [b"{\"params\":".repeat(2000), b"}".repeat(2000)].concat();
        for (body, kind) in [
            (b"" as &[u8], Kind::JsonMalformed),
            (b"[]", Kind::JsonMalformed),
            (b"{\"image\": \"AQID\",}", Kind::JsonMalformed),
            (&deep, Kind::JsonMalformed),
            (b"{\"image\": \"AQID\", \"image\": \"AQID\"}", Kind::DuplicateParameter),
            (b"{\"imgae\": \"AQID\"}", Kind::UnknownParameter),
            (b"{\"image\": 5}", Kind::ParameterMalformed),
            (b"{\"image\": \"A\"}", Kind::ParameterMalformed),
            (b"{\"image\": \"AQI\"}", Kind::ParameterMalformed),
            (b"{\"image\": \"AQ ID\"}", Kind::ParameterMalformed),
            (b"{\"params\": {\"size\": {}}}", Kind::JsonMalformed),
        ] {
            assert_eq!(image(body), Err(kind), "{}", String::from_utf8_lossy(body));
        }
    }
}
