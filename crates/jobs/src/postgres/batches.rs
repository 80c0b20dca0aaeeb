//! Concurrent requests of one kind share a transaction.
//!
//! Requests that arrive while a batch is running form the next batch: a single request never waits
//! for others, and under load a commit serves many.

use crate::queue::QueueError;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot};

/// The most requests of one batch.
const MAX_BATCH: usize = 256;

type Reply<A> = oneshot::Sender<Result<A, QueueError>>;

/// Runs requests of type `Q` in batches and returns to each its response of type `A`.
#[derive(Debug)]
pub(super) struct Batcher<Q, A>(mpsc::UnboundedSender<(Q, Reply<A>)>);

impl<Q, A> Batcher<Q, A>
where
    Q: Clone + Send + Sync + 'static,
    A: Send + 'static,
{
    /// `run` returns the responses to a batch in the order of its requests.
    pub(super) fn start<N, F>(
        node: &Arc<N>,
        run: impl Fn(Arc<N>, Arc<[Q]>) -> F + Send + 'static,
    ) -> Self
    where
        N: Send + Sync + 'static,
        F: Future<Output = Result<Vec<A>, QueueError>> + Send + 'static,
    {
        let node = Arc::clone(node);
        let run = move |requests| run(Arc::clone(&node), requests);
        let (sender, mut receiver) = mpsc::unbounded_channel::<(Q, Reply<A>)>();
        tokio::spawn(async move {
            let mut received = Vec::new();
            while receiver.recv_many(&mut received, MAX_BATCH).await > 0 {
                let (requests, replies): (Vec<Q>, Vec<Reply<A>>) = received.drain(..).unzip();
                let requests: Arc<[Q]> = requests.into();
                let responses = match run(Arc::clone(&requests)).await {
                    Ok(responses) => responses.into_iter().map(Ok).collect(),
                    // One request that the database refuses must not fail the others.
                    Err(QueueError::Database(_)) if requests.len() > 1 => {
                        let mut responses = Vec::new();
                        for request in &*requests {
                            let alone = run([request.clone()].into()).await;
                            responses.push(alone.and_then(|mut one| one.pop().ok_or_else(stopped)));
                        }
                        responses
                    }
                    Err(error) => replies.iter().map(|_| Err(error.clone())).collect(),
                };
                for (reply, response) in replies.into_iter().zip(responses) {
                    let _ = reply.send(response);
                }
            }
        });
        Self(sender)
    }

    /// Sends a request and waits for its response.
    pub(super) async fn run(&self, request: Q) -> Result<A, QueueError> {
        let (reply, response) = oneshot::channel();
        self.0.send((request, reply)).map_err(|_| stopped())?;
        response.await.map_err(|_| stopped())?
    }

    /// Sends a request whose response nobody needs.
    pub(super) fn send(&self, request: Q) {
        let _ = self.0.send((request, oneshot::channel().0));
    }
}

fn stopped() -> QueueError {
    QueueError::Database("the batches of requests have stopped".into())
}
