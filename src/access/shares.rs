//! Counts how many units of a shared resource each holder has.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Counts what each holder has.
#[derive(Debug)]
pub struct Shares<H>(Mutex<HashMap<H, usize>>);

/// One unit of a holder, released when dropped.
#[derive(Debug)]
pub struct Share<H: Eq + Hash> {
    shares: Arc<Shares<H>>,
    holder: H,
}

impl<H> Default for Shares<H> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<H: Eq + Hash + Clone> Shares<H> {
    /// Takes one more, unless the holder has `most` already.
    pub fn take(self: &Arc<Self>, holder: &H, most: usize) -> Option<Share<H>> {
        let mut held = self.held();
        let count = held.get(holder).copied().unwrap_or_default();
        (count < most).then(|| {
            held.insert(holder.clone(), count + 1);
            Share { shares: Arc::clone(self), holder: holder.clone() }
        })
    }
}

impl<H> Shares<H> {
    fn held(&self) -> MutexGuard<'_, HashMap<H, usize>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<H: Eq + Hash> Drop for Share<H> {
    fn drop(&mut self) {
        let mut held = self.shares.held();
        if let Some(count) = held.get_mut(&self.holder) {
            *count -= 1;
            if *count == 0 {
                held.remove(&self.holder);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_holder_has_its_own_number() {
        let shares = Arc::new(Shares::default());
        let held: Vec<_> = (0..3).map_while(|_| shares.take(&"a", 2)).collect();
        assert_eq!(held.len(), 2);
        let other = shares.take(&"b", 2);
        assert!(other.is_some());
        drop(held);
        assert!(shares.take(&"a", 2).is_some());
        drop(other);
        assert!(shares.held().is_empty());
    }
}
