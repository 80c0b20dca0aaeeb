//! Rate limit of a key's name, in requests per minute.
//!
//! The generic cell rate algorithm: a minute's worth may come at once, and each comes back by
//! itself after its share of the minute.

use governor::RateLimiter;
use governor::clock::{Clock, DefaultClock};
use governor::middleware::StateInformationMiddleware;
use governor::state::{InMemoryState, NotKeyed};
use std::num::NonZeroU32;
use std::time::Duration;

/// The quota of one name.
#[derive(Debug)]
pub struct Quota {
    per_minute: NonZeroU32,
    limiter: RateLimiter<NotKeyed, InMemoryState, DefaultClock, StateInformationMiddleware>,
}

/// The state of a quota after a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing {
    /// Requests per minute.
    pub per_minute: u32,
    /// Requests left now.
    pub remaining: u32,
    /// Whole seconds until one more is left, at least 1.
    pub reset_s: u64,
}

impl Quota {
    /// A quota of so many requests per minute.
    #[must_use]
    pub fn new(per_minute: NonZeroU32) -> Self {
        let limiter = RateLimiter::direct(governor::Quota::per_minute(per_minute));
        Self { per_minute, limiter: limiter.with_middleware() }
    }

    /// Requests per minute.
    #[must_use]
    pub fn per_minute(&self) -> NonZeroU32 {
        self.per_minute
    }

    /// Takes one request.
    ///
    /// # Errors
    /// Where the name stands, when none is left.
    pub fn take(&self) -> Result<Standing, Standing> {
        let one_s = 60.0 / f64::from(self.per_minute.get());
        match self.limiter.check() {
            Ok(state) => Ok(self.standing(state.remaining_burst_capacity(), one_s)),
            Err(not_yet) => {
                let wait: Duration = not_yet.wait_time_from(DefaultClock::default().now());
                Err(self.standing(0, wait.as_secs_f64()))
            }
        }
    }

    fn standing(&self, remaining: u32, reset_s: f64) -> Standing {
        let reset_s = reset_s.ceil().max(1.0) as u64;
        Standing { per_minute: self.per_minute.get(), remaining, reset_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minutes_worth_may_come_at_once_and_not_one_more() {
        let quota = Quota::new(NonZeroU32::new(3).unwrap());
        for remaining in [2, 1, 0] {
            assert_eq!(quota.take().unwrap().remaining, remaining);
        }
        let refused = quota.take().unwrap_err();
        assert_eq!((refused.remaining, refused.per_minute), (0, 3));
        assert!((19..=20).contains(&refused.reset_s), "{refused:?}");
    }
}
