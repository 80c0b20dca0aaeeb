//! Between rows and what is kept of a job.

use crate::record::{Event, JobId, Moment, Picture, Progress, Record, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use rusqlite::types::Type;
use rusqlite::{Result, Row};
use serde::de::DeserializeOwned;
use std::str::FromStr;

/// The columns that [`record`] reads.
pub(super) const RECORD: &str = "id, owner, state, attempt, order_query, image_digest, image_bytes, \
     image_shape, stage, fraction, mesh, problem, created_ms, started_ms, finished_ms, expires_ms, \
     revision";

/// The columns that [`event`] reads.
pub(super) const EVENT: &str = "revision, at_ms, state, attempt, stage, fraction";

/// A job of a row with the columns [`RECORD`].
pub(super) fn record(row: &Row<'_>) -> Result<Record> {
    Ok(Record {
        id: id(row, "id")?,
        owner: owner(row)?,
        state: state(row)?,
        attempt: row.get("attempt")?,
        order: row.get("order_query")?,
        picture: picture(row)?,
        progress: progress(row)?,
        mesh: json(row, "mesh")?,
        problem: json(row, "problem")?,
        created: Moment(row.get("created_ms")?),
        started: moment(row, "started_ms")?,
        finished: moment(row, "finished_ms")?,
        expires: moment(row, "expires_ms")?,
        revision: row.get("revision")?,
    })
}

/// An event of a row with the columns [`EVENT`].
pub(super) fn event(row: &Row<'_>) -> Result<Event> {
    Ok(Event {
        revision: row.get("revision")?,
        at: Moment(row.get("at_ms")?),
        state: state(row)?,
        attempt: row.get("attempt")?,
        progress: progress(row)?,
    })
}

/// The picture of a row with its three columns.
pub(super) fn picture(row: &Row<'_>) -> Result<Picture> {
    let shape = json(row, "image_shape")?.ok_or_else(|| unreadable("image_shape"))?;
    Ok(Picture { digest: parsed(row, "image_digest")?, bytes: row.get("image_bytes")?, shape })
}

/// The name of a job in a column.
pub(super) fn id(row: &Row<'_>, column: &str) -> Result<JobId> {
    row.get(column).map(JobId::from_bytes)
}

/// The owner of a row.
pub(super) fn owner(row: &Row<'_>) -> Result<Owner> {
    let name: String = row.get("owner")?;
    Ok(Owner::of_stored(&name))
}

/// The state of a row.
pub(super) fn state(row: &Row<'_>) -> Result<State> {
    let number: usize = row.get("state")?;
    State::ALL.get(number).copied().ok_or_else(|| unreadable("state"))
}

/// A digest in a column.
pub(super) fn digest(row: &Row<'_>, column: &str) -> Result<Digest> {
    parsed(row, column)
}

fn progress(row: &Row<'_>) -> Result<Option<Progress>> {
    let stage: Option<String> = row.get("stage")?;
    let fraction: Option<f64> = row.get("fraction")?;
    Ok(stage.zip(fraction).map(|(stage, fraction)| Progress { stage, fraction }))
}

fn moment(row: &Row<'_>, column: &str) -> Result<Option<Moment>> {
    Ok(row.get::<_, Option<i64>>(column)?.map(Moment))
}

fn json<T: DeserializeOwned>(row: &Row<'_>, column: &str) -> Result<Option<T>> {
    let text: Option<String> = row.get(column)?;
    text.map(|text| serde_json::from_str(&text).map_err(|_| unreadable(column))).transpose()
}

fn parsed<T: FromStr>(row: &Row<'_>, column: &str) -> Result<T> {
    let text: String = row.get(column)?;
    text.parse().map_err(|_| unreadable(column))
}

fn unreadable(column: &str) -> rusqlite::Error {
    rusqlite::Error::InvalidColumnType(0, column.to_owned(), Type::Text)
}
