//! Workers keep jobs: all leases of a node in one statement.

use super::Node;
use super::row::{self, ms, number, uuid};
use crate::embedded::watchers::Changes;
use crate::queue::{Lease, QueueError, Renewal};
use crate::record::{Progress, State};
use sqlx::Row;
use sqlx::postgres::PgRow;
use std::collections::HashMap;

impl Node {
    /// Lengthens leases, and takes down how far the work is.
    pub(super) async fn renew(
        &self,
        asked: &[(Lease, Option<Progress>)],
    ) -> Result<Vec<Renewal>, QueueError> {
        let rows = self.database.retry(|| self.try_renew(asked)).await?;
        let mut held = HashMap::new();
        for row in &rows {
            let read = row::id(row).and_then(|id| Ok((id, row.try_get("cancel_requested")?)));
            let (id, cancel_requested) = read.map_err(|error| super::database::failure(&error))?;
            held.insert(id, standing_of(cancel_requested));
        }
        let renewal = |(lease, _): &(Lease, Option<Progress>)| {
            let renewal = held.get(&lease.job).copied().unwrap_or(Renewal::Lost);
            match renewal {
                Renewal::Lost => self.leases.remove(*lease),
                _ => self.leases.keep(*lease, self.terms.lease),
            }
            renewal
        };
        let renewals = asked.iter().map(renewal).collect();
        let jobs = asked.iter().filter(|(_, news)| news.is_some()).map(|(lease, _)| lease.job);
        self.notifications.send(Changes { jobs: jobs.collect(), work: false });
        Ok(renewals)
    }

    async fn try_renew(&self, asked: &[(Lease, Option<Progress>)]) -> sqlx::Result<Vec<PgRow>> {
        let stage = |(_, news): &(Lease, Option<Progress>)| Some(news.as_ref()?.stage.clone());
        let fraction = |(_, news): &(Lease, Option<Progress>)| Some(news.as_ref()?.fraction);
        let mut transaction = self.database.begin().await?;
        let rows = transaction
            .query(
                "UPDATE jobs SET lease_end = now() + $5 * interval '1 millisecond',
                    stage = COALESCE(new.stage, jobs.stage),
                    fraction = COALESCE(new.fraction, jobs.fraction),
                    progress_at = CASE WHEN new.stage IS NULL THEN progress_at ELSE now() END,
                    revision = CASE WHEN new.stage IS NULL THEN revision ELSE revision + 1 END
             FROM unnest($1::uuid[], $2::bigint[], $3::text[], $4::double precision[])
                  AS new (id, fence, stage, fraction)
             WHERE jobs.id = new.id AND jobs.state = 1 AND jobs.fence = new.fence
             RETURNING jobs.id, cancel_requested",
            )
            .bind(asked.iter().map(|(lease, _)| uuid(lease.job)).collect::<Vec<_>>())
            .bind(asked.iter().map(|(lease, _)| lease.fence as i64).collect::<Vec<_>>())
            .bind(asked.iter().map(stage).collect::<Vec<_>>())
            .bind(asked.iter().map(fraction).collect::<Vec<_>>())
            .bind(ms(self.terms.lease))
            .fetch_all(&mut *transaction)
            .await?;
        transaction.commit().await?;
        Ok(rows)
    }

    /// Whether a worker still has a job, and shall have it.
    pub(super) async fn standing(&self, lease: Lease) -> Result<Renewal, QueueError> {
        let read = || async {
            let mut reading = self.database.reading().await?;
            let found = reading
                .query("SELECT state, fence, cancel_requested FROM jobs WHERE id = $1")
                .bind(uuid(lease.job))
                .fetch_optional(&mut *reading)
                .await?;
            reading.commit().await?;
            let Some(found) = found else { return Ok(Renewal::Lost) };
            let holder = (row::state(&found)?, number::<i64, u64>(&found, "fence")?);
            Ok(if holder == (State::Running, lease.fence) {
                standing_of(found.try_get("cancel_requested")?)
            } else {
                Renewal::Lost
            })
        };
        let standing = self.database.retry(read).await?;
        if standing == Renewal::Lost {
            self.leases.remove(lease);
        }
        Ok(standing)
    }
}

fn standing_of(cancel_requested: bool) -> Renewal {
    if cancel_requested { Renewal::CancelRequested } else { Renewal::Ok }
}
