//! Reading jobs from the rows of a query, the same for both engines.

use crate::queue::{Claim, Lease};
use crate::record::{Event, JobId, Moment, Picture, Record, State};
use crate::transition::Status;
use pixmesh_engine::Owner;
use pixmesh_engine::digest::Digest;
use serde::de::DeserializeOwned;

/// A row whose columns are read by name. A column that holds an impossible value is an error.
pub(crate) trait Row {
    type Error;

    fn integer(&self, column: &str) -> Result<Option<i64>, Self::Error>;
    fn flag(&self, column: &str) -> Result<bool, Self::Error>;
    fn text(&self, column: &str) -> Result<Option<String>, Self::Error>;
    fn moment(&self, column: &str) -> Result<Option<Moment>, Self::Error>;
    fn digest(&self, column: &str) -> Result<Option<Digest>, Self::Error>;
    fn id(&self) -> Result<JobId, Self::Error>;
    /// Four numbers for each change of state: revision, milliseconds since 1970, state, attempt.
    fn history(&self) -> Result<Vec<i64>, Self::Error>;
    /// The error for a column with an impossible value.
    fn damaged(column: &str) -> Self::Error;
}

/// A query for jobs with the columns of [`record`].
macro_rules! select_record {
    ($rest:literal) => {
        concat!(
            "SELECT id, owner, state, attempt, options, image_digest, image_bytes, image_shape, \
             progress, mesh, problem, created_at, started_at, finished_at, expires_at, revision ",
            $rest
        )
    };
}
pub(crate) use select_record;

pub(crate) fn record<R: Row>(row: &R) -> Result<Record, R::Error> {
    Ok(Record {
        id: row.id()?,
        owner: owner(row)?,
        state: state(row)?,
        attempt: number(row, "attempt")?,
        options: row.text("options")?.unwrap_or_default(),
        picture: picture(row)?,
        progress: json(row, "progress")?,
        mesh: json(row, "mesh")?,
        problem: json(row, "problem")?,
        created: row.moment("created_at")?.ok_or_else(|| R::damaged("created_at"))?,
        started: row.moment("started_at")?,
        finished: row.moment("finished_at")?,
        expires: row.moment("expires_at")?,
        revision: number(row, "revision")?,
    })
}

/// The claim of a job that is now running.
pub(crate) fn claim<R: Row>(row: &R) -> Result<Claim, R::Error> {
    Ok(Claim {
        lease: Lease { job: row.id()?, fence: number(row, "fence")? },
        owner: owner(row)?,
        attempt: number(row, "attempt")?,
        options: row.text("options")?.unwrap_or_default(),
        picture: picture(row)?,
    })
}

pub(crate) fn status<R: Row>(row: &R) -> Result<Status, R::Error> {
    Ok(Status {
        state: state(row)?,
        fence: number(row, "fence")?,
        attempt: number(row, "attempt")?,
        cancel_requested: row.flag("cancel_requested")?,
    })
}

/// The changes of a job after a revision: those of its state, and its last progress.
pub(crate) fn events<R: Row>(row: &R, after: u64) -> Result<Vec<Event>, R::Error> {
    let history = row.history()?;
    let mut events = Vec::new();
    for [revision, at, number, attempt] in history.as_chunks().0 {
        events.push(Event {
            revision: revision.unsigned_abs(),
            at: Moment(*at),
            state: known_state(*number).ok_or_else(|| R::damaged("history"))?,
            attempt: u32::try_from(*attempt).map_err(|_| R::damaged("history"))?,
            progress: None,
        });
    }
    if let (Some(progress), Some(at)) = (json(row, "progress")?, row.moment("progress_at")?) {
        let (revision, attempt) = (number(row, "revision")?, number(row, "attempt")?);
        let progress = Some(progress);
        events.push(Event { revision, at, state: state(row)?, attempt, progress });
    }
    events.retain(|event| event.revision > after);
    Ok(events)
}

pub(crate) fn owner<R: Row>(row: &R) -> Result<Owner, R::Error> {
    Ok(Owner::of_stored(&row.text("owner")?.unwrap_or_default()))
}

pub(crate) fn state<R: Row>(row: &R) -> Result<State, R::Error> {
    let number = row.integer("state")?;
    number.and_then(known_state).ok_or_else(|| R::damaged("state"))
}

/// A number that is not negative.
pub(crate) fn number<R: Row, N: TryFrom<i64>>(row: &R, column: &str) -> Result<N, R::Error> {
    let number = row.integer(column)?.and_then(|number| N::try_from(number).ok());
    number.ok_or_else(|| R::damaged(column))
}

fn picture<R: Row>(row: &R) -> Result<Picture, R::Error> {
    Ok(Picture {
        digest: row.digest("image_digest")?.ok_or_else(|| R::damaged("image_digest"))?,
        bytes: number(row, "image_bytes")?,
        shape: json(row, "image_shape")?.ok_or_else(|| R::damaged("image_shape"))?,
    })
}

fn json<R: Row, T: DeserializeOwned>(row: &R, column: &str) -> Result<Option<T>, R::Error> {
    let text = row.text(column)?;
    text.map(|text| serde_json::from_str(&text).map_err(|_| R::damaged(column))).transpose()
}

fn known_state(number: i64) -> Option<State> {
    State::ALL.get(usize::try_from(number).ok()?).copied()
}
