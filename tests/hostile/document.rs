//! The table as it is published, against the one that is tested.
//!
//! `PIXMESH_WRITE_DOCS=1` writes it anew.

use crate::table::Row;
use crate::{awkward, bombs, containers, lifecycle, meshes, names, parameters, transport};
use std::collections::HashSet;
use std::fmt::Write;

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/inputs.md");
const BEGIN: &str = "<!-- The tables below are written by the tests. -->\n";
const END: &str = "<!-- End of the tables. -->\n";

/// Every chapter with its rows.
fn chapters() -> [(&'static str, Vec<Row>); 8] {
    [
        ("Bombs", bombs::rows()),
        ("Broken containers and disguises", containers::rows()),
        ("Valid but awkward", awkward::rows()),
        ("Transport and forms", transport::rows()),
        ("Names and headers", names::rows()),
        ("Parameters", parameters::rows()),
        ("Meshes", meshes::rows()),
        ("Jobs", lifecycle::rows()),
    ]
}

/// The tables as text.
fn tables() -> String {
    let mut text = String::new();
    for (title, rows) in chapters() {
        write!(text, "\n### {title}\n\n| id | input | answer |\n|---|---|---|\n").unwrap();
        for row in rows {
            writeln!(text, "| {} | {} | {} |", row.id, row.what.replace('|', "\\|"), row.expected)
                .unwrap();
        }
    }
    text + "\n"
}

#[test]
fn the_document_has_the_table_that_is_tested() {
    let document = std::fs::read_to_string(DOCUMENT).unwrap();
    let (before, rest) = document.split_once(BEGIN).unwrap();
    let (written, after) = rest.split_once(END).unwrap();
    let tables = tables();
    if std::env::var_os("PIXMESH_WRITE_DOCS").is_some() {
        std::fs::write(DOCUMENT, format!("{before}{BEGIN}{tables}{END}{after}")).unwrap();
    } else {
        assert!(
            written == tables,
            "write it anew: PIXMESH_WRITE_DOCS=1 cargo test --test hostile document"
        );
    }
}

#[test]
fn every_row_has_a_name_of_its_own_and_none_is_missing() {
    let rows: Vec<Row> = chapters().into_iter().flat_map(|(_, rows)| rows).collect();
    let ids: HashSet<&str> = rows.iter().map(|row| row.id).collect();
    assert_eq!(ids.len(), rows.len());
    for (letter, count) in
        [('B', 25), ('C', 20), ('V', 12), ('T', 15), ('H', 8), ('P', 14), ('M', 11), ('J', 9)]
    {
        for number in 1..=count {
            let id = format!("{letter}{number:02}");
            assert!(ids.contains(id.as_str()), "{id} is missing");
        }
    }
}
