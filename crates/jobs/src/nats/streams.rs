//! The streams that jobs are kept in, made and checked at the start.
//!
//! | stream | names in it | what |
//! |---|---|---|
//! | `work` | `work.{owner}.{job}` | one message for each job that has not ended; taken away with its end |
//! | `jobs` | `job.{owner}.{job}` | the record of each job |
//! | `words` | `word.{digest}` | what a client's word for a submission was given for |
//! | `gone` | `gone.{owner}.{job}` | that there was a job |
//! | `blobs` | `ref.{blob}.{job}`, `free.{blob}`, `turn.sweep`, `turn.pace` | which jobs have a blob, which blobs were given up, who sweeps, and how long jobs take |
//!
//! An owner is written as `o` and the hexadecimal digits of its name, so that any name is one word
//! of a subject and owners order like their names.

use super::broker::{Broker, failure};
use super::table::Table;
use crate::queue::{QueueError, Terms};
use crate::record::JobId;
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType};
use pixmesh_engine::Owner;
use std::time::Duration;

/// The shortest age that a stream can be told.
const SHORTEST_AGE: Duration = Duration::from_secs(1);
/// How many messages more than jobs may wait the stream of work takes: those of jobs that run.
const ROOM_FOR_RUNNING: usize = 1024;

/// The way to each stream.
#[derive(Clone, Debug)]
pub(super) struct Streams {
    pub(super) work: Table,
    pub(super) jobs: Table,
    pub(super) words: Table,
    pub(super) gone: Table,
    pub(super) blobs: Table,
}

impl Streams {
    /// Makes those that are missing, and changes those that are otherwise than the terms ask.
    pub(super) async fn open(broker: &Broker, terms: &Terms) -> Result<Self, QueueError> {
        for config in configs(broker, terms) {
            provide(broker, config).await?;
        }
        Ok(Self {
            work: Table::of(broker, "work").await?,
            jobs: Table::of(broker, "jobs").await?,
            words: Table::of(broker, "words").await?,
            gone: Table::of(broker, "gone").await?,
            blobs: Table::of(broker, "blobs").await?,
        })
    }
}

fn configs(broker: &Broker, terms: &Terms) -> [Config; 5] {
    let newest = |kind: &str, names: &[&str]| Config {
        name: broker.stream_name(kind),
        subjects: names.iter().map(|name| format!("{}.{name}", broker.prefix)).collect(),
        storage: StorageType::File,
        num_replicas: broker.replicas,
        max_messages_per_subject: 1,
        ..Config::default()
    };
    let most = terms.caps.queued.saturating_add(ROOM_FOR_RUNNING);
    [
        Config {
            description: Some("jobs to do".into()),
            retention: RetentionPolicy::WorkQueue,
            discard: DiscardPolicy::New,
            // A second message for the same job is refused, however late it comes.
            discard_new_per_subject: true,
            max_messages: i64::try_from(most).unwrap_or(i64::MAX),
            ..newest("work", &["work.*.*"])
        },
        Config { description: Some("records of jobs".into()), ..newest("jobs", &["job.*.*"]) },
        Config {
            description: Some("words for submissions".into()),
            max_age: terms.idempotency_ttl.max(SHORTEST_AGE),
            duplicate_window: SHORTEST_AGE,
            ..newest("words", &["word.*"])
        },
        Config {
            description: Some("jobs that there were".into()),
            max_age: terms.gone_ttl.max(SHORTEST_AGE),
            duplicate_window: SHORTEST_AGE,
            ..newest("gone", &["gone.*.*"])
        },
        Config {
            description: Some("who has which blob".into()),
            ..newest("blobs", &["ref.*.*", "free.*", "turn.*"])
        },
    ]
}

/// Makes a stream where there is none, and changes one that is otherwise.
async fn provide(broker: &Broker, config: Config) -> Result<(), QueueError> {
    let name = config.name.clone();
    let stream = broker.made(|| broker.context.get_or_create_stream(config.clone())).await;
    let what = format!("stream {name} cannot be made with --queue-replicas {}", broker.replicas);
    let stream = stream.map_err(|error| failure(&what, &error))?;
    let found = &stream.cached_info().config;
    if found.retention != config.retention || found.subjects != config.subjects {
        return Err(QueueError::Broker(format!(
            "stream {name} is there already and not of this program: name another --queue-prefix"
        )));
    }
    let is_as_asked = found.max_messages == config.max_messages || config.max_messages == 0;
    if is_as_asked && found.num_replicas == config.num_replicas && found.max_age == config.max_age {
        return Ok(());
    }
    let changed = Config {
        max_messages: if config.max_messages == 0 {
            found.max_messages
        } else {
            config.max_messages
        },
        max_age: config.max_age,
        num_replicas: config.num_replicas,
        ..found.clone()
    };
    let updated = broker.context.update_stream(changed).await;
    updated
        .map(|_| ())
        .map_err(|error| failure(&format!("stream {name} cannot be changed"), &error))
}

/// The word for an owner in subjects.
pub(super) fn owner_word(owner: &Owner) -> String {
    let digits = owner.as_str().bytes().map(|byte| format!("{byte:02x}"));
    std::iter::once("o".to_owned()).chain(digits).collect()
}

/// The owner of a word.
pub(super) fn owner_of_word(word: &str) -> Option<Owner> {
    let digits = word.strip_prefix('o')?.as_bytes();
    let digit = |letter: &u8| char::from(*letter).to_digit(16);
    let byte = |pair: &[u8]| match pair {
        [high, low] => u8::try_from(digit(high)? << 4 | digit(low)?).ok(),
        _ => None,
    };
    let bytes: Option<Vec<u8>> = digits.chunks(2).map(byte).collect();
    Some(Owner::of_stored(&String::from_utf8(bytes?).ok()?))
}

/// The job that a name of the form `kind.{owner}.{job}` is of.
pub(super) fn job_of_name(name: &str) -> Option<(Owner, JobId)> {
    let (rest, job) = name.rsplit_once('.')?;
    let (_, owner) = rest.rsplit_once('.')?;
    Some((owner_of_word(owner)?, JobId::parse(job)?))
}

/// The blob and the job that a name of the form `ref.{blob}.{job}` is of.
pub(super) fn reference_of(name: &str) -> Option<(&str, JobId)> {
    let (blob, id) = name.strip_prefix("ref.")?.split_once('.')?;
    Some((blob, JobId::parse(id)?))
}

/// The name of a job's record.
pub(super) fn record_name(owner: &Owner, id: JobId) -> String {
    format!("job.{}.{id}", owner_word(owner))
}

/// The name of a job's message.
pub(super) fn work_name(owner: &Owner, id: JobId) -> String {
    format!("work.{}.{id}", owner_word(owner))
}

/// The name under which it is kept that there was a job.
pub(super) fn gone_name(owner: &Owner, id: JobId) -> String {
    format!("gone.{}.{id}", owner_word(owner))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_owner_has_a_word_that_reads_back_and_orders_like_its_name() {
        let owners = ["", "a", "a ", "a.b", "é>*", "z"].map(Owner::of_stored);
        let words = owners.each_ref().map(owner_word);
        for (owner, word) in owners.iter().zip(&words) {
            assert!(word.bytes().all(|byte| byte.is_ascii_alphanumeric()), "{word}");
            assert_eq!(owner_of_word(word).as_ref(), Some(owner));
        }
        let mut pairs: Vec<_> = owners.iter().zip(&words).collect();
        pairs.sort();
        assert!(pairs.is_sorted_by_key(|(_, word)| *word));
        for wrong in ["", "61", "o6", "oxy", "o+1"] {
            assert_eq!(owner_of_word(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn the_job_of_a_name_reads_back() {
        let (owner, id) = (Owner::named("a.b"), JobId::new());
        assert_eq!(job_of_name(&work_name(&owner, id)), Some((owner, id)));
        assert_eq!(job_of_name("work.o61"), None);
    }
}
