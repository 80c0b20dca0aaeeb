//! The columns of the tables as values.

use crate::record::{JobId, Moment};
use crate::row::Row;
use pixmesh_engine::digest::Digest;
use sqlx::error::BoxDynError;
use sqlx::postgres::{PgRow, PgTypeInfo, PgValueRef};
use sqlx::{Decode, Postgres, Result, Row as _, Type};
use std::time::Duration;
use uuid::Uuid;

impl Row for PgRow {
    type Error = sqlx::Error;

    fn integer(&self, column: &str) -> Result<Option<i64>> {
        let wide = || self.try_get(column);
        let int4 = || self.try_get::<Option<i32>, _>(column).map(|number| number.map(i64::from));
        let int2 = || self.try_get::<Option<i16>, _>(column).map(|number| number.map(i64::from));
        wide().or_else(|_| int4()).or_else(|_| int2())
    }

    fn flag(&self, column: &str) -> Result<bool> {
        self.try_get(column)
    }

    fn text(&self, column: &str) -> Result<Option<String>> {
        self.try_get(column)
    }

    fn moment(&self, column: &str) -> Result<Option<Moment>> {
        self.try_get(column)
    }

    fn digest(&self, column: &str) -> Result<Option<Digest>> {
        self.try_get::<Option<[u8; 32]>, _>(column).map(|bytes| bytes.map(Digest::from))
    }

    fn id(&self) -> Result<JobId> {
        self.try_get("id").map(|id: Uuid| JobId::from_bytes(id.into_bytes()))
    }

    fn history(&self) -> Result<Vec<i64>> {
        self.try_get("history")
    }

    fn damaged(column: &str) -> sqlx::Error {
        sqlx::Error::Decode(format!("the column {column} cannot be read").into())
    }
}

/// The id of a job as the database stores it.
pub(super) fn uuid(id: JobId) -> Uuid {
    Uuid::from_bytes(*id.as_bytes())
}

/// A duration in milliseconds, at most a thousand years, so that the database can add it to a time.
pub(super) fn ms(duration: Duration) -> i64 {
    const MAX: Duration = Duration::from_hours(24 * 365_000);
    duration.min(MAX).as_millis() as i64
}

/// The bytes of digests, to bind.
pub(super) fn bytes(digests: &[Digest]) -> Vec<&[u8]> {
    digests.iter().map(|digest| digest.as_bytes().as_slice()).collect()
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
    /// The binary protocol sends microseconds since the year 2000.
    fn decode(value: PgValueRef<'_>) -> std::result::Result<Self, BoxDynError> {
        const YEAR_2000_MS: i64 = 946_684_800_000;
        let us: i64 = Decode::<Postgres>::decode(value)?;
        Ok(Self(us.div_euclid(1000) + YEAR_2000_MS))
    }
}
