//! New tables, and tables of other versions.

use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_that_start_at_once_create_the_tables() {
    for is_pooled in [false, true] {
        let engine = engine("at_once", is_pooled);
        let nodes = futures_util::future::join_all((0..4).map(|_| engine.opened(terms()))).await;
        submit(&nodes[0], &Owner::Anonymous, "image").await;
        assert!(nodes[3].claim().await.unwrap().is_some());
        let sql = format!("SELECT count(*) FROM \"{}\".job_counts", engine.schema);
        assert_eq!(engine.server.0.run_sql(&sql), "64");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn later_version_is_refused() {
    let engine = engine("later", false);
    let running = engine.opened(terms()).await;
    engine.server.0.run_sql(&format!(
        "INSERT INTO \"{}\"._sqlx_migrations VALUES (99, 'later', now(), true, '', 0)",
        engine.schema
    ));
    let error = engine.try_open(terms()).await.unwrap_err().to_string();
    assert!(error.contains("version 99") && error.contains("supports version 3"), "{error}");
    // A node that runs already keeps running.
    submit(&running, &Owner::Anonymous, "image").await;
    assert!(running.claim().await.unwrap().is_some());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn frequent_queries_use_indexes() {
    let engine = engine("plans", false);
    drop(engine.opened(terms()).await);
    let table = |name: &str| format!("\"{}\".{name}", engine.schema);
    engine.server.0.run_sql(&format!(
        "INSERT INTO {jobs} (id, owner, state, attempt, fence, cancel_requested, options,
                             image_digest, image_bytes, image_shape, created_at, revision, history,
                             mesh_digest, expires_at)
         SELECT gen_random_uuid(), 'o' || n % 100, n % 5, 0, 0, false, '', sha256(n::text::bytea),
                1, '', now(), 1, '{{}}', sha256(n::text::bytea), now() + n * interval '1 second'
         FROM generate_series(1, 20000) AS n; ANALYZE {jobs}",
        jobs = table("jobs")
    ));
    for condition in [
        "state = 0 AND owner > 'o5' ORDER BY owner LIMIT 1",
        "state = 0 AND owner = 'o5' ORDER BY id LIMIT 1",
        "state = 1 AND owner = 'o5'",
        "state = 3 AND owner = 'o5' AND id < gen_random_uuid() ORDER BY id DESC LIMIT 100",
        "state = 0 ORDER BY created_at LIMIT 1",
        "expires_at <= now() - interval '1 second' ORDER BY expires_at LIMIT 2000",
        "state IN (0, 1, 3) AND image_digest = '\\x00'",
        "state = 3 AND id >= gen_random_uuid() AND id < gen_random_uuid() ORDER BY id DESC LIMIT 9",
        "state = 3 AND problem_type = '/problems/rare' ORDER BY id DESC LIMIT 9",
        "mesh_digest = '\\x00'",
    ] {
        let sql = format!("EXPLAIN SELECT id FROM {} WHERE {condition}", table("jobs"));
        let plan = engine.server.0.run_sql(&sql);
        assert!(plan.contains("Index") && !plan.contains("Seq Scan"), "{condition}: {plan}");
    }
}
