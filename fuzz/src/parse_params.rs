//! Parameters: a query, and after a zero byte JSON.

use pixmesh_engine::params::ParameterSet;

/// Reads parameters both ways.
pub fn run(bytes: &[u8]) {
    let split = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    let (query, json) = bytes.split_at(split);
    if let Ok(query) = std::str::from_utf8(query)
        && let Ok(set) = ParameterSet::of_query(Some(query))
    {
        check(&set);
    }
    let mut set = ParameterSet::default();
    if set.add_json(json.get(1..).unwrap_or_default()).is_ok() {
        check(&set);
    }
}

/// What was understood, written as a query, means the same.
fn check(set: &ParameterSet) {
    let Ok(order) = set.finish() else { return };
    let query = order.query();
    let again = ParameterSet::of_query(Some(&query)).and_then(|set| set.finish());
    let again = again.unwrap_or_else(|problem| panic!("{query}: {problem:?}"));
    assert_eq!(again.query(), query);
    assert_eq!(again.parameters, order.parameters, "{query}");
    assert_eq!(again.output, order.output, "{query}");
}
