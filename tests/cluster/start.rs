//! Settings that prevent a start, and the errors that name them.

use crate::node::program;
use pixmesh_test_support::postgres::free_port;

/// Checks that the program ends with an error that contains texts.
#[track_caller]
pub(crate) fn refused(flags: &[&str], texts: &[&str]) {
    let output = program().args(flags).output().unwrap();
    assert!(!output.status.success());
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    for text in texts {
        assert!(error.contains(text), "{text} in {error}");
    }
}

#[test]
fn contradicting_settings_are_refused_with_the_ones_that_work() {
    refused(&["worker"], &["--queue postgres://"]);
    refused(&["serve", "--no-worker"], &["--no-worker", "--queue postgres://"]);
    refused(&["serve", "--blobs", "s3://bucket"], &["--blobs s3://bucket", "--queue postgres://"]);
    let shared = ["serve", "--queue", "postgres://a/b"];
    refused(&shared, &["--blobs file", "file:///FOLDER", "s3://BUCKET"]);
    refused(&["serve", "--queue", "redis://a"], &["postgres://HOST:PORT/DATABASE"]);
    refused(&["serve", "--queue-schema", "a.b"], &["--queue-schema"]);
}

#[test]
fn a_database_that_does_not_answer_is_named() {
    let queue = format!("postgres://pixmesh:secret@127.0.0.1:{}/jobs", free_port());
    let flags = ["worker", "--ops-listen", "127.0.0.1:0", "--blobs", "file:///tmp", "--queue"];
    let shown = queue.replace("pixmesh:secret@", "");
    refused(&[&flags[..], &[&queue]].concat(), &["--queue", &shown, "does not answer"]);
}
