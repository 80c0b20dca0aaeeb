//! What many ask at the same time is done in one transaction.
//!
//! While a transaction is under way, what is asked meanwhile is gathered for the next: whoever is
//! alone waits for nobody, and the more there are the fewer commits each of them costs.

use crate::queue::QueueError;
use std::sync::Arc;
use tokio::sync::{mpsc, oneshot};

/// The most that is done in one transaction.
const MOST: usize = 256;

type Answer<A> = oneshot::Sender<Result<A, QueueError>>;

/// Gathers questions of one kind.
#[derive(Debug)]
pub(super) struct Batcher<Q, A>(mpsc::UnboundedSender<(Q, Answer<A>)>);

impl<Q, A> Batcher<Q, A>
where
    Q: Clone + Send + Sync + 'static,
    A: Send + 'static,
{
    /// Starts to gather for what answers all questions, each in its place.
    pub(super) fn start<F>(answer: impl Fn(Arc<[Q]>) -> F + Send + 'static) -> Self
    where
        F: Future<Output = Result<Vec<A>, QueueError>> + Send + 'static,
    {
        let (sender, mut asked) = mpsc::unbounded_channel::<(Q, Answer<A>)>();
        tokio::spawn(async move {
            let mut gathered = Vec::new();
            while asked.recv_many(&mut gathered, MOST).await > 0 {
                let (questions, answers): (Vec<Q>, Vec<Answer<A>>) = gathered.drain(..).unzip();
                let questions: Arc<[Q]> = questions.into();
                let done = answer(Arc::clone(&questions)).await;
                if matches!(done, Err(QueueError::Database(_))) && questions.len() > 1 {
                    // One that the database does not take spoils none of the others.
                    for (question, reply) in questions.iter().zip(answers) {
                        let alone = answer([question.clone()].into()).await;
                        let _ = reply.send(alone.and_then(|mut done| done.pop().ok_or_else(gone)));
                    }
                    continue;
                }
                match done {
                    Ok(done) => answers.into_iter().zip(done).for_each(|(reply, done)| {
                        let _ = reply.send(Ok(done));
                    }),
                    Err(error) => answers.into_iter().for_each(|reply| {
                        let _ = reply.send(Err(error.clone()));
                    }),
                }
            }
        });
        Self(sender)
    }

    /// Asks, and waits for the answer.
    pub(super) async fn ask(&self, question: Q) -> Result<A, QueueError> {
        let (reply, answer) = oneshot::channel();
        self.0.send((question, reply)).map_err(|_| gone())?;
        answer.await.map_err(|_| gone())?
    }

    /// Asks, and waits for nothing.
    pub(super) fn tell(&self, question: Q) {
        let _ = self.0.send((question, oneshot::channel().0));
    }
}

fn gone() -> QueueError {
    QueueError::Database("what writes jobs has ended".into())
}
