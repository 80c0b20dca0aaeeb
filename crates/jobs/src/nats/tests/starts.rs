//! What a node waits for when it starts, and what it does not wait for.

use super::*;
use async_nats::jetstream::context::{CreateStreamError, CreateStreamErrorKind};
use async_nats::jetstream::{Error as ServerError, ErrorCode};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// How often something is asked for that is refused twice with a code, and what comes of it.
async fn made(broker: &Broker, code: u64) -> (usize, Result<(), CreateStreamError>) {
    let asked = AtomicUsize::new(0);
    let make = || {
        let is_refused = asked.fetch_add(1, Ordering::SeqCst) < 2 && code != 0;
        let error = serde_json::json!({ "code": 503, "err_code": code });
        let error: ServerError = serde_json::from_value(error).unwrap();
        let refused = CreateStreamError::new(CreateStreamErrorKind::JetStream(error));
        std::future::ready(if is_refused { Err(refused) } else { Ok(()) })
    };
    let made = broker.made(make).await;
    (asked.into_inner(), made)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_cluster_that_forms_is_asked_again_and_whoever_refuses_is_believed() {
    let Some(program) = nats_server::program() else { return };
    let broker_of = async |server: &NatsServer| {
        let client = async_nats::connect(server.address()).await.unwrap();
        let context = async_nats::jetstream::new(client.clone());
        Broker { client, context, prefix: "pixmesh".into(), replicas: 1 }
    };
    let routes = nats_server::free_port();
    let member = NatsServer::start_with(
        &program,
        &format!("server_name: n0\ncluster {{ name: c, listen: \"127.0.0.1:{routes}\" }}"),
    );
    let alone = NatsServer::start_with(&program, "");
    let (member, alone) = (broker_of(&member).await, broker_of(&alone).await);
    for code in [
        ErrorCode::CLUSTER_INCOMPLETE,
        ErrorCode::CLUSTER_NO_PEERS,
        ErrorCode::CLUSTER_NOT_ACTIVE,
        ErrorCode::CLUSTER_NOT_AVAILABLE,
        ErrorCode::INSUFFICIENT_RESOURCES,
    ] {
        let (asked, made) = made(&member, code.0).await;
        assert!(asked == 3 && made.is_ok(), "{code:?}: {asked}, {made:?}");
    }
    let (forming, refused) = (ErrorCode::INSUFFICIENT_RESOURCES, ErrorCode::STREAM_SUBJECT_OVERLAP);
    for (broker, code) in [(&alone, forming), (&alone, refused), (&member, refused)] {
        let (asked, made) = made(broker, code.0).await;
        assert!(asked == 1 && made.is_err(), "{code:?}: {asked}, {made:?}");
    }
    for broker in [&alone, &member] {
        let (asked, made) = made(broker, 0).await;
        assert!(asked == 1 && made.is_ok(), "{asked}, {made:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_has_no_streams_is_left_at_once() {
    let Some(program) = nats_server::program() else { return };
    let server = NatsServer::start_with(&program, "");
    let began = Instant::now();
    let error = Broker::connect(&settings(&server.address(), &[])).await.unwrap_err().to_string();
    assert!(error.contains("has no JetStream") && error.contains("-js"), "{error}");
    // A start would take 15 seconds if it were waited for.
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
}

/// What may be allowed while the node starts, or answered later by a busy server.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_whose_streams_do_not_answer_yet_is_waited_for() {
    let Some(program) = nats_server::program() else { return };
    let users = |publish: &str| {
        format!(
            "jetstream {{ store_dir: \"STORE\" }}\n\
             authorization {{ users: [ {{ user: u, password: p, permissions: {{ publish: \"{publish}\" }} }} ] }}"
        )
    };
    let mut server = NatsServer::start_with(&program, &users("pixmesh.>"));
    let settings = settings(&format!("nats://u:p@127.0.0.1:{}", server.port), &[]);
    let connecting = tokio::spawn(async move { Broker::connect(&settings).await });
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(!connecting.is_finished(), "{:?}", connecting.await);
    server.restart_with(&users(">"));
    connecting.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_is_not_there_yet_is_waited_for() {
    let Some(program) = nats_server::program() else { return };
    let port = nats_server::free_port();
    let settings = settings(&format!("nats://127.0.0.1:{port}"), &[]);
    let connecting = tokio::spawn(async move { Broker::connect(&settings).await });
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(!connecting.is_finished(), "{:?}", connecting.await);
    let _server = NatsServer::start_at(&program, port, "jetstream { store_dir: \"STORE\" }");
    connecting.await.unwrap().unwrap();
}
