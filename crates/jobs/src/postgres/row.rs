//! Between rows and what is kept of a job.

use crate::record::{Event, JobId, Moment, Picture, Progress, Record, State};
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde::de::DeserializeOwned;
use sqlx::error::BoxDynError;
use sqlx::postgres::{PgRow, PgTypeInfo, PgValueRef};
use sqlx::{Decode, Postgres, Result, Row, Type};
use std::time::Duration;
use uuid::Uuid;

/// What begins a question for jobs, with the columns that [`record`] reads.
macro_rules! select_record {
    ($rest:literal) => {
        concat!(
            "SELECT id, owner, state, attempt, order_query, image_digest, image_bytes, image_shape, \
             stage, fraction, mesh, problem, created_at, started_at, finished_at, expires_at, \
             revision ",
            $rest
        )
    };
}
pub(super) use select_record;

/// A job of a row with the columns of [`select_record`].
pub(super) fn record(row: &PgRow) -> Result<Record> {
    Ok(Record {
        id: id(row)?,
        owner: owner(row)?,
        state: state(row)?,
        attempt: number::<i32, _>(row, "attempt")?,
        order: row.try_get("order_query")?,
        picture: picture(row)?,
        progress: progress(row)?,
        mesh: json(row, "mesh")?,
        problem: json(row, "problem")?,
        created: row.try_get("created_at")?,
        started: row.try_get("started_at")?,
        finished: row.try_get("finished_at")?,
        expires: row.try_get("expires_at")?,
        revision: revision(row.try_get("revision")?),
    })
}

/// The changes of a row's job after a revision: those of its state, and its last progress.
pub(super) fn events(row: &PgRow, after: u64) -> Result<Vec<Event>> {
    let history: Vec<i64> = row.try_get("history")?;
    let change = |change: &[i64; 4]| {
        let [at_revision, at_ms, state, attempt] = *change;
        Ok(Event {
            revision: revision(at_revision),
            at: Moment(at_ms),
            state: usize::try_from(state)
                .ok()
                .and_then(known_state)
                .ok_or(unreadable("history"))?,
            attempt: u32::try_from(attempt).map_err(|_| unreadable("history"))?,
            progress: None,
        })
    };
    let mut events: Vec<Event> = history.as_chunks().0.iter().map(change).collect::<Result<_>>()?;
    if let (Some(progress), Some(at)) = (progress(row)?, row.try_get("progress_at")?) {
        events.push(Event {
            revision: revision(row.try_get("revision")?),
            at,
            state: state(row)?,
            attempt: number::<i32, _>(row, "attempt")?,
            progress: Some(progress),
        });
    }
    events.retain(|event| event.revision > after);
    Ok(events)
}

/// The picture of a row with its three columns.
pub(super) fn picture(row: &PgRow) -> Result<Picture> {
    let shape = json(row, "image_shape")?.ok_or(unreadable("image_shape"))?;
    Ok(Picture {
        digest: digest(row, "image_digest")?,
        bytes: number::<i64, _>(row, "image_bytes")?,
        shape,
    })
}

/// The name of a row's job.
pub(super) fn id(row: &PgRow) -> Result<JobId> {
    row.try_get("id").map(|id: Uuid| JobId::from_bytes(id.into_bytes()))
}

/// A job's name, as the database has it.
pub(super) fn uuid(id: JobId) -> Uuid {
    Uuid::from_bytes(*id.as_bytes())
}

/// The owner of a row.
pub(super) fn owner(row: &PgRow) -> Result<Owner> {
    row.try_get("owner").map(Owner::of_stored)
}

/// The state of a row.
pub(super) fn state(row: &PgRow) -> Result<State> {
    known_state(number::<i16, _>(row, "state")?).ok_or(unreadable("state"))
}

/// A digest in a column.
pub(super) fn digest(row: &PgRow, column: &'static str) -> Result<Digest> {
    let bytes: [u8; 32] = row.try_get(column)?;
    Ok(bytes.into())
}

/// A number that is not negative, of a column whose numbers are `D`.
pub(super) fn number<'r, D, N>(row: &'r PgRow, column: &'static str) -> Result<N>
where
    D: Into<i64> + Decode<'r, Postgres> + Type<Postgres>,
    N: TryFrom<i64>,
{
    let wide = row.try_get::<D, _>(column)?.into();
    N::try_from(wide).map_err(|_| unreadable(column))
}

/// A duration as the database adds it: in milliseconds, up to a thousand years.
pub(super) fn ms(duration: Duration) -> i64 {
    const MOST: Duration = Duration::from_hours(24 * 365_000);
    duration.min(MOST).as_millis() as i64
}

fn known_state(number: usize) -> Option<State> {
    State::ALL.get(number).copied()
}

/// Revisions count from 1, and only ever up.
fn revision(number: i64) -> u64 {
    number.unsigned_abs()
}

fn progress(row: &PgRow) -> Result<Option<Progress>> {
    let (stage, fraction): (Option<String>, Option<f64>) =
        (row.try_get("stage")?, row.try_get("fraction")?);
    Ok(stage.zip(fraction).map(|(stage, fraction)| Progress { stage, fraction }))
}

fn json<T: DeserializeOwned>(row: &PgRow, column: &'static str) -> Result<Option<T>> {
    let text: Option<&str> = row.try_get(column)?;
    text.map(|text| serde_json::from_str(text).map_err(|_| unreadable(column))).transpose()
}

fn unreadable(column: &str) -> sqlx::Error {
    sqlx::Error::Decode(format!("the column {column} cannot be read").into())
}

impl Type<Postgres> for Moment {
    fn type_info() -> PgTypeInfo {
        PgTypeInfo::with_name("timestamptz")
    }

    fn compatible(found: &PgTypeInfo) -> bool {
        found.to_string().eq_ignore_ascii_case("timestamptz")
    }
}

impl Decode<'_, Postgres> for Moment {
    /// Microseconds since the year 2000, as the binary protocol has them.
    fn decode(value: PgValueRef<'_>) -> std::result::Result<Self, BoxDynError> {
        const YEAR_2000_MS: i64 = 946_684_800_000;
        let us: i64 = Decode::<Postgres>::decode(value)?;
        Ok(Self(us.div_euclid(1000) + YEAR_2000_MS))
    }
}
