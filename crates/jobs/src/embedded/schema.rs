//! The tables, and the connections to the database.

use rusqlite::{Connection, OpenFlags, Result};
use std::path::Path;
use std::time::Duration;

/// The version of the tables, which the database stores.
const VERSION: i64 = 4;

/// States are the numbers of `State::ALL`: 0 queued, 1 running, 2 and more have ended. Times are in
/// milliseconds since 1970, except those of leases, which are those of the process's own clock.
const TABLES: &str = "
CREATE TABLE jobs (
    id BLOB NOT NULL PRIMARY KEY,
    owner TEXT NOT NULL,
    state INTEGER NOT NULL,
    attempt INTEGER NOT NULL,
    fence INTEGER NOT NULL,
    lease_end INTEGER,
    cancel_requested INTEGER NOT NULL,
    idempotency_key TEXT,
    fingerprint TEXT,
    options TEXT NOT NULL,
    image_digest TEXT NOT NULL,
    image_bytes INTEGER NOT NULL,
    image_shape TEXT NOT NULL,
    progress TEXT,
    progress_at INTEGER,
    mesh TEXT,
    mesh_digest TEXT,
    problem TEXT,
    created_at INTEGER NOT NULL,
    started_at INTEGER,
    finished_at INTEGER,
    expires_at INTEGER,
    revision INTEGER NOT NULL,
    -- Four numbers for each change of state: revision, milliseconds since 1970, state, attempt.
    history TEXT NOT NULL
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, owner, id);
CREATE INDEX jobs_of_owner ON jobs (owner, id);
CREATE INDEX jobs_queued ON jobs (created_at) WHERE state = 0;
CREATE INDEX jobs_expiring ON jobs (expires_at) WHERE expires_at IS NOT NULL;
CREATE INDEX jobs_with_mesh ON jobs (mesh_digest) WHERE mesh_digest IS NOT NULL;
CREATE UNIQUE INDEX jobs_idempotency_keys ON jobs (owner, idempotency_key)
    WHERE idempotency_key IS NOT NULL;
-- Expired jobs, for which clients get 410 instead of 404.
CREATE TABLE gone (
    id BLOB NOT NULL PRIMARY KEY,
    owner TEXT NOT NULL,
    until INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE INDEX gone_until ON gone (until);
-- Blobs that no job may use any more.
CREATE TABLE orphan_candidates (
    blob TEXT NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;
-- A row that each sweep writes, to check that the storage takes writes.
CREATE TABLE pulse (
    id INTEGER NOT NULL PRIMARY KEY CHECK (id = 0),
    at INTEGER NOT NULL
) STRICT;
";

/// The tables that version 2 lacks.
const SINCE_VERSION_3: &str = "
-- Idempotency keys of jobs that are deleted.
CREATE TABLE kept_keys (
    owner TEXT NOT NULL,
    idempotency_key TEXT NOT NULL,
    until INTEGER NOT NULL,
    PRIMARY KEY (owner, idempotency_key)
) STRICT, WITHOUT ROWID;
CREATE INDEX kept_keys_until ON kept_keys (until);
";

/// What version 3 lacks.
const SINCE_VERSION_4: &str = "
-- The type of the problem of a failed job.
ALTER TABLE jobs ADD COLUMN problem_type TEXT
    AS (CASE WHEN json_valid(problem) THEN problem ->> 'type' END);
CREATE INDEX jobs_with_problem ON jobs (problem_type, id) WHERE problem_type IS NOT NULL;
CREATE INDEX jobs_in_state ON jobs (state, id);
-- Pictures of failed jobs are kept, too.
DROP INDEX IF EXISTS jobs_with_image;
CREATE INDEX jobs_with_image ON jobs (image_digest) WHERE state IN (0, 1, 3);
-- One row, once something was paused.
CREATE TABLE paused (
    id INTEGER NOT NULL PRIMARY KEY CHECK (id = 0),
    intake INTEGER NOT NULL,
    work INTEGER NOT NULL
) STRICT;
";

/// Opens the database for writing, and creates it if there is none.
pub(super) fn open(path: &Path) -> Result<Connection> {
    let connection = Connection::open(path)?;
    connection.busy_timeout(Duration::from_secs(10))?;
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.set_prepared_statement_cache_capacity(64);
    let missing: &[&str] = match version(&connection)? {
        0 => &[TABLES, SINCE_VERSION_3, SINCE_VERSION_4],
        2 => &[SINCE_VERSION_3, SINCE_VERSION_4],
        3 => &[SINCE_VERSION_4],
        VERSION => &[],
        other => return Err(of_other_version(other)),
    };
    if !missing.is_empty() {
        let missing = missing.concat();
        connection.execute_batch(&format!(
            "BEGIN IMMEDIATE; {missing} PRAGMA user_version = {VERSION}; COMMIT;"
        ))?;
    }
    Ok(connection)
}

fn version(connection: &Connection) -> Result<i64> {
    connection.pragma_query_value(None, "user_version", |row| row.get(0))
}

/// Opens the database of a process that may be running, or of none, and changes nothing in its folder.
pub(super) fn open_unchanged(path: &Path) -> Result<Connection> {
    let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
    connection.busy_timeout(Duration::from_secs(10))?;
    match version(&connection)? {
        VERSION => Ok(connection),
        other => Err(of_other_version(other)),
    }
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
    let reason =
        format!("its tables have version {found}, and this program supports version {VERSION}");
    rusqlite::Error::InvalidPath(reason.into())
}
