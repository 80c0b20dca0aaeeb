//! Workers renew their leases: all leases of a node in one statement.

use super::database::failure;
use super::node::Node;
use super::rows::{ms, uuid};
use crate::queue::{Lease, QueueError, Renewal};
use crate::record::Progress;
use crate::row::{Row, number};
use crate::watchers::Changes;
use std::collections::HashMap;

impl Node {
    /// Renews leases, and stores new progress.
    pub(super) async fn renew(
        &self,
        requests: &[(Lease, Option<Progress>)],
    ) -> Result<Vec<Renewal>, QueueError> {
        let progress = |(_, progress): &(Lease, Option<Progress>)| {
            progress.as_ref().and_then(|progress| serde_json::to_string(progress).ok())
        };
        let statement = || {
            sqlx::query(
                "UPDATE jobs SET lease_end = now() + $4 * interval '1 millisecond',
                    progress = COALESCE(new.progress, jobs.progress),
                    progress_at = CASE WHEN new.progress IS NULL THEN progress_at ELSE now() END,
                    revision = CASE WHEN new.progress IS NULL THEN revision ELSE revision + 1 END
                 FROM unnest($1::uuid[], $2::bigint[], $3::text[]) AS new (id, fence, progress)
                 WHERE jobs.id = new.id AND jobs.state = 1 AND jobs.fence = new.fence
                 RETURNING jobs.id, jobs.fence, cancel_requested",
            )
            .bind(requests.iter().map(|(lease, _)| uuid(lease.job)).collect::<Vec<_>>())
            .bind(requests.iter().map(|(lease, _)| lease.fence as i64).collect::<Vec<_>>())
            .bind(requests.iter().map(progress).collect::<Vec<_>>())
            .bind(ms(self.terms.lease))
        };
        let mut renewed = HashMap::new();
        for row in self.database.execute(statement).await? {
            let columns = || {
                let lease = Lease { job: row.id()?, fence: number(&row, "fence")? };
                Ok((lease, row.flag("cancel_requested")?))
            };
            let (lease, is_cancelled) = columns().map_err(|error: sqlx::Error| failure(&error))?;
            renewed
                .insert(lease, if is_cancelled { Renewal::CancelRequested } else { Renewal::Ok });
        }
        let renewal = |(lease, _): &(Lease, Option<Progress>)| {
            let renewal = renewed.get(lease).copied().unwrap_or(Renewal::Lost);
            match renewal {
                Renewal::Lost => self.leases.remove(*lease),
                _ => self.leases.renew(*lease, self.terms.lease),
            }
            renewal
        };
        let renewals = requests.iter().map(renewal).collect();
        let progressed = requests.iter().filter(|(_, progress)| progress.is_some());
        let jobs = progressed.map(|(lease, _)| lease.job).collect();
        self.notifications.send(Changes { jobs, work: false });
        Ok(renewals)
    }
}
