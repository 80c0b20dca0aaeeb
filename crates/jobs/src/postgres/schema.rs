//! The tables and their versions.
//!
//! Nodes that start at the same time take turns by locking a row. All migrations run in one
//! transaction, as poolers require. Nodes of an earlier version keep running with tables of a later
//! one, but do not start with them.

use super::database::{Database, failure};
use super::settings::PostgresSettings;
use crate::queue::QueueError;
use sqlx::AssertSqlSafe;
use sqlx::migrate::{MigrateError, Migrator};
use std::error::Error;

/// All versions of the tables.
static VERSIONS: Migrator = sqlx::migrate!("src/postgres/migrations");

/// Creates the tables, or migrates them to the version of this program.
///
/// # Errors
/// When the tables have a later version, or cannot be created.
pub(super) async fn migrate(
    database: &Database,
    settings: &PostgresSettings,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let schema = &settings.queue_schema;
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
        let mut transaction = database.begin_migration().await?;
        let discard = || sqlx::raw_sql(database.discard_statements());
        discard().execute(&mut *transaction).await?;
        sqlx::raw_sql("SET LOCAL statement_timeout = 0; SELECT id FROM migrating FOR UPDATE")
            .execute(&mut *transaction)
            .await?;
        let changed = versions.run_direct(None, &mut *transaction, false).await;
        match changed {
            Err(MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _)) => {
                Err(error)
            }
            other => {
                discard().execute(&mut *transaction).await?;
                transaction.commit().await?;
                Ok(other)
            }
        }
    };
    let newest = VERSIONS.iter().map(|version| version.version).max().unwrap_or_default();
    database.retry(change).await?.map_err(|error| match error {
        MigrateError::VersionMissing(found) => format!(
            "the tables in schema {schema} have version {found}, and this program supports version \
             {newest}: start a program that is as new as the newest node"
        )
        .into(),
        other => QueueError::Database(other.to_string()).into(),
    })
}
