//! The tables, and how the database is opened.

use rusqlite::{Connection, Result};
use std::path::Path;
use std::time::Duration;

/// The version of the tables below, which the database carries.
const VERSION: i64 = 1;

/// An index of some rows only serves a question that repeats its condition: who asks for jobs in
/// state 0 or 1 must ask for states below 2, too.
///
/// State numbers are those of `State::ALL`: 0 waits, 1 runs, 2 and more are ends.
const TABLES: &str = "
CREATE TABLE jobs (
    id BLOB NOT NULL PRIMARY KEY,
    owner TEXT NOT NULL,
    state INTEGER NOT NULL,
    attempt INTEGER NOT NULL DEFAULT 0,
    fence INTEGER NOT NULL DEFAULT 0,
    lease_end_ms INTEGER,
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    order_query TEXT NOT NULL,
    image_digest TEXT NOT NULL,
    image_bytes INTEGER NOT NULL,
    image_shape TEXT NOT NULL,
    has_image INTEGER NOT NULL DEFAULT 1,
    stage TEXT,
    fraction REAL,
    mesh TEXT,
    mesh_digest TEXT,
    problem TEXT,
    created_ms INTEGER NOT NULL,
    started_ms INTEGER,
    finished_ms INTEGER,
    expires_ms INTEGER,
    is_gone INTEGER NOT NULL DEFAULT 0,
    revision INTEGER NOT NULL
) STRICT;
CREATE INDEX jobs_at_work ON jobs (state, owner, id) WHERE state < 2;
CREATE INDEX jobs_of_owner ON jobs (owner, id) WHERE is_gone = 0;
CREATE INDEX jobs_expiring ON jobs (is_gone, expires_ms) WHERE expires_ms IS NOT NULL;
CREATE INDEX jobs_with_image ON jobs (image_digest) WHERE has_image = 1;
CREATE INDEX jobs_with_mesh ON jobs (mesh_digest) WHERE mesh_digest IS NOT NULL;
CREATE TABLE events (
    job BLOB NOT NULL,
    revision INTEGER NOT NULL,
    at_ms INTEGER NOT NULL,
    state INTEGER NOT NULL,
    attempt INTEGER NOT NULL,
    stage TEXT,
    fraction REAL,
    PRIMARY KEY (job, revision)
) STRICT, WITHOUT ROWID;
CREATE TABLE turns (
    owner TEXT NOT NULL PRIMARY KEY,
    turn INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE idempotency (
    owner TEXT NOT NULL,
    word TEXT NOT NULL,
    fingerprint TEXT NOT NULL,
    job BLOB NOT NULL,
    until_ms INTEGER NOT NULL,
    PRIMARY KEY (owner, word)
) STRICT, WITHOUT ROWID;
CREATE INDEX idempotency_of_job ON idempotency (job);
CREATE INDEX idempotency_ending ON idempotency (until_ms);
CREATE TABLE given_up (
    blob TEXT NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;
CREATE TABLE pulse (
    id INTEGER NOT NULL PRIMARY KEY CHECK (id = 0),
    at_ms INTEGER NOT NULL
) STRICT;
";

/// Opens the database for writing, and makes it where there is none.
pub(super) fn open(path: &Path) -> Result<Connection> {
    let connection = Connection::open(path)?;
    connection.busy_timeout(Duration::from_secs(10))?;
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.set_prepared_statement_cache_capacity(64);
    match connection.pragma_query_value(None, "user_version", |row| row.get(0))? {
        0 => connection.execute_batch(&format!(
            "BEGIN IMMEDIATE; {TABLES} PRAGMA user_version = {VERSION}; COMMIT;"
        ))?,
        VERSION => {}
        other => return Err(of_other_version(other)),
    }
    Ok(connection)
}

/// Opens the database for reading.
pub(super) fn open_for_reading(path: &Path) -> Result<Connection> {
    let connection = Connection::open(path)?;
    connection.busy_timeout(Duration::from_secs(10))?;
    connection.pragma_update(None, "query_only", true)?;
    connection.set_prepared_statement_cache_capacity(64);
    Ok(connection)
}

fn of_other_version(found: i64) -> rusqlite::Error {
    let reason = format!("its tables are of version {found}, and this program's of {VERSION}");
    rusqlite::Error::InvalidPath(reason.into())
}
