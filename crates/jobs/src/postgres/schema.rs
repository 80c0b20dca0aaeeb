//! The tables, and how a database comes to have them.
//!
//! Nodes that start at the same time wait for each other at a row. All is done in one transaction, which a
//! pooler passes on as a whole. A node of an earlier version goes on with tables of a later one while
//! it runs; once it ends, it is not started again beside them.

use super::database::{Database, failure};
use super::settings::PostgresSettings;
use crate::queue::QueueError;
use sqlx::AssertSqlSafe;
use sqlx::migrate::{MigrateError, Migrator};
use std::error::Error;

/// Every version of the tables.
static VERSIONS: Migrator = sqlx::migrate!("src/postgres/migrations");

/// Makes the tables what this program needs.
///
/// # Errors
/// When they are those of a later version, or cannot be made.
pub(super) async fn migrate(
    database: &Database,
    settings: &PostgresSettings,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let schema = &settings.schema;
    let prepared = format!(
        "CREATE SCHEMA IF NOT EXISTS \"{schema}\";
         CREATE TABLE IF NOT EXISTS migrating (id integer NOT NULL PRIMARY KEY);
         INSERT INTO migrating VALUES (0) ON CONFLICT DO NOTHING"
    );
    let prepare = || async {
        let mut transaction = database.begin().await?;
        sqlx::raw_sql(AssertSqlSafe(prepared.as_str())).execute(&mut *transaction).await?;
        transaction.commit().await
    };
    database
        .attempts(prepare)
        .await
        .map_err(|error| settings.explain(&error).unwrap_or_else(|| failure(&error).to_string()))?;
    let versions =
        Migrator { locking: false, migrations: VERSIONS.migrations.clone(), ..Migrator::DEFAULT };
    let change = || async {
        let mut transaction = database.begin_outer().await?;
        let forget = || sqlx::raw_sql(database.forget_statements());
        forget().execute(&mut *transaction).await?;
        sqlx::raw_sql("SET LOCAL statement_timeout = 0; SELECT id FROM migrating FOR UPDATE")
            .execute(&mut *transaction)
            .await?;
        let changed = versions.run_direct(None, &mut *transaction, false).await;
        match changed {
            Err(MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _)) => {
                Err(error)
            }
            other => {
                forget().execute(&mut *transaction).await?;
                transaction.commit().await?;
                Ok(other)
            }
        }
    };
    let newest = VERSIONS.iter().map(|version| version.version).max().unwrap_or_default();
    database.retry(change).await?.map_err(|error| match error {
        MigrateError::VersionMissing(found) => format!(
            "the tables in schema {schema} are of version {found}, and this program's of {newest}: \
             start a program that is as new as the newest node"
        )
        .into(),
        other => QueueError::Database(other.to_string()).into(),
    })
}
