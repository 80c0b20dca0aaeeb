//! Lines of comma-separated values: fields that hold a comma or a quote are quoted.

/// The fields of a line; `None` when a quote is not closed or stands where none may.
#[must_use]
pub fn split(line: &str) -> Option<Vec<String>> {
    let mut fields = Vec::new();
    let mut rest = line;
    loop {
        let (field, after) = next_field(rest)?;
        fields.push(field);
        match after.strip_prefix(',') {
            Some(next) => rest = next,
            None => return after.is_empty().then_some(fields),
        }
    }
}

/// The first field, and what comes after it.
fn next_field(line: &str) -> Option<(String, &str)> {
    let Some(mut rest) = line.strip_prefix('"') else {
        let (field, after) = line.split_at(line.find(',').unwrap_or(line.len()));
        return (!field.contains('"')).then(|| (field.to_owned(), after));
    };
    let mut field = String::new();
    loop {
        let (text, after) = rest.split_once('"')?;
        field.push_str(text);
        match after.strip_prefix('"') {
            Some(after) => {
                field.push('"');
                rest = after;
            }
            None => return Some((field, after)),
        }
    }
}

/// A line of these fields, without its end. Line ends within a field become blanks, so that a
/// record is always one line.
#[must_use]
pub fn join<S: AsRef<str>>(fields: &[S]) -> String {
    let quoted: Vec<String> = fields.iter().map(|field| quote(field.as_ref())).collect();
    quoted.join(",")
}

/// A field, quoted where it needs to be.
fn quote(field: &str) -> String {
    let field = field.replace(['\n', '\r'], " ");
    if field.contains([',', '"']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_read_back_as_they_were_written() {
        for fields in [vec!["a", "", "PSD(Max,D)"], vec!["\"", ",\",", "x y"], vec![""]] {
            assert_eq!(split(&join(&fields)).unwrap(), fields);
        }
        assert_eq!(join(&["two\nlines"]), "two lines");
    }

    #[test]
    fn quotes_out_of_place_are_no_fields() {
        for line in ["\"open", "a\"b", "\"a\"b,c", "\"a\"\"", "x,\"y"] {
            assert_eq!(split(line), None, "{line}");
        }
    }
}
