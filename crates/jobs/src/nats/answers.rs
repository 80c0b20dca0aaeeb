//! What the broker answered, where that is an error: the client keeps the server's error now among
//! the causes of its own, now in the kind of its own.

use async_nats::jetstream::context::{
    AccountError, AccountErrorKind, ConsumerInfoError, ConsumerInfoErrorKind, CreateStreamError,
    CreateStreamErrorKind, GetStreamError, GetStreamErrorKind,
};
use async_nats::jetstream::stream::{
    ConsumerError, ConsumerErrorKind, DeleteMessageError, DeleteMessageErrorKind, PurgeError,
    PurgeErrorKind, RawMessageError, RawMessageErrorKind,
};
use async_nats::jetstream::{Error as ServerError, ErrorCode};
use std::error::Error;

/// The code of the server's error in one of the client's; `None` when the server did not answer.
pub(super) fn server_code(error: &(dyn Error + 'static)) -> Option<ErrorCode> {
    std::iter::successors(Some(error), |&error| error.source()).find_map(|cause| {
        let own = cause.downcast_ref::<ServerError>().map(ServerError::error_code);
        own.or_else(|| code_of_kind(cause))
    })
}

/// The code of the server's error in the kind of one of the client's. Of some codes that is all that
/// the client keeps.
fn code_of_kind(error: &(dyn Error + 'static)) -> Option<ErrorCode> {
    macro_rules! kept {
        ($($client:ty { $($kind:pat => $code:expr,)+ })+) => {
            $(if let Some(error) = error.downcast_ref::<$client>() {
                return match error.kind() {
                    $($kind => Some($code),)+
                    _ => None,
                };
            })+
        };
    }
    kept! {
        AccountError { AccountErrorKind::JetStream(error) => error.error_code(), }
        GetStreamError { GetStreamErrorKind::JetStream(error) => error.error_code(), }
        CreateStreamError {
            CreateStreamErrorKind::JetStream(error) => error.error_code(),
            CreateStreamErrorKind::NotFound => ErrorCode::STREAM_NOT_FOUND,
        }
        ConsumerError { ConsumerErrorKind::JetStream(error) => error.error_code(), }
        ConsumerInfoError {
            ConsumerInfoErrorKind::JetStream(error) => error.error_code(),
            ConsumerInfoErrorKind::NotFound => ErrorCode::CONSUMER_NOT_FOUND,
            ConsumerInfoErrorKind::StreamNotFound => ErrorCode::STREAM_NOT_FOUND,
            ConsumerInfoErrorKind::Offline => ErrorCode::CONSUMER_OFFLINE,
        }
        RawMessageError {
            RawMessageErrorKind::JetStream(error) => error.error_code(),
            RawMessageErrorKind::NoMessageFound => ErrorCode::NO_MESSAGE_FOUND,
        }
        DeleteMessageError { DeleteMessageErrorKind::JetStream(error) => error.error_code(), }
        PurgeError { PurgeErrorKind::JetStream(error) => error.error_code(), }
    }
    None
}
