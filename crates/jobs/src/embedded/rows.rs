//! The columns of the tables as values.

use crate::record::{JobId, Moment};
use crate::row::Row;
use pixmesh_engine::digest::Digest;
use rusqlite::types::Type;
use rusqlite::{Connection, Error, OptionalExtension, Params, Result};

impl Row for rusqlite::Row<'_> {
    type Error = Error;

    fn integer(&self, column: &str) -> Result<Option<i64>> {
        self.get(column)
    }

    fn flag(&self, column: &str) -> Result<bool> {
        self.get(column)
    }

    fn text(&self, column: &str) -> Result<Option<String>> {
        self.get(column)
    }

    fn moment(&self, column: &str) -> Result<Option<Moment>> {
        self.integer(column).map(|ms| ms.map(Moment))
    }

    fn digest(&self, column: &str) -> Result<Option<Digest>> {
        self.text(column)?.map(|text| text.parse().map_err(|_| Self::damaged(column))).transpose()
    }

    fn id(&self) -> Result<JobId> {
        self.get("id").map(JobId::from_bytes)
    }

    fn history(&self) -> Result<Vec<i64>> {
        let text: String = self.get("history")?;
        let numbers = text.split_whitespace().map(str::parse);
        numbers.collect::<std::result::Result<_, _>>().map_err(|_| Self::damaged("history"))
    }

    fn damaged(column: &str) -> Error {
        Error::InvalidColumnType(0, column.to_owned(), Type::Text)
    }
}

/// The first row of a query.
pub(super) fn first<T>(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
    read: impl FnOnce(&rusqlite::Row<'_>) -> Result<T>,
) -> Result<Option<T>> {
    connection.prepare_cached(sql)?.query_row(parameters, read).optional()
}

/// All rows of a query.
pub(super) fn all<T>(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
    read: impl FnMut(&rusqlite::Row<'_>) -> Result<T>,
) -> Result<Vec<T>> {
    connection.prepare_cached(sql)?.query_map(parameters, read)?.collect()
}
