//! Whose job is next.
//!
//! Owners take turns: the next job is the oldest one of the owner who had a turn least recently,
//! among those who have jobs waiting and fewer running than they may. A hundred jobs of one owner
//! so delay another's only by those that run already.

use pixmesh_engine::Owner;

/// How many jobs may wait and run. Where no keys are asked for, nobody in particular owns them all,
/// and the bounds of one owner do not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caps {
    /// Jobs that wait, of all owners.
    pub queued: usize,
    /// Jobs that wait, of one owner.
    pub queued_per_owner: usize,
    /// Jobs that run, of one owner.
    pub running_per_owner: usize,
}

impl Caps {
    /// Jobs of this owner that may wait.
    #[must_use]
    pub fn queued_of(&self, owner: &Owner) -> usize {
        if owner.is_key() { self.queued_per_owner } else { self.queued }
    }

    /// Jobs of this owner that may run.
    #[must_use]
    pub fn running_of(&self, owner: &Owner) -> usize {
        if owner.is_key() { self.running_per_owner } else { usize::MAX }
    }
}

/// The jobs of one owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnerLoad {
    /// Whose.
    pub owner: Owner,
    /// Jobs that wait.
    pub queued: usize,
    /// Jobs that run.
    pub running: usize,
    /// Number of the owner's last turn; 0 when there was none.
    pub last_turn: u64,
}

/// The owner whose turn it is; `None` when nobody may have another job run.
#[must_use]
pub fn next_owner<'a>(loads: &'a [OwnerLoad], caps: &Caps) -> Option<&'a OwnerLoad> {
    let may_run =
        |load: &&OwnerLoad| load.queued > 0 && load.running < caps.running_of(&load.owner);
    loads.iter().filter(may_run).min_by_key(|load| (load.last_turn, &load.owner))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAPS: Caps = Caps { queued: 1000, queued_per_owner: 1000, running_per_owner: 2 };

    fn load(name: &str, queued: usize, running: usize, last_turn: u64) -> OwnerLoad {
        OwnerLoad { owner: Owner::of_stored(name), queued, running, last_turn }
    }

    #[test]
    fn owners_take_turns_however_many_jobs_they_have() {
        let mut loads = [load("a", 100, 0, 0), load("b", 3, 0, 0), load("c", 1, 0, 0)];
        let caps = Caps { running_per_owner: 100, ..CAPS };
        let mut order = String::new();
        for turn in 1..=8 {
            let Some(owner) = next_owner(&loads, &caps).map(|load| load.owner.clone()) else {
                break;
            };
            order += owner.as_str();
            let next = loads.iter_mut().find(|load| load.owner == owner).unwrap();
            (next.queued, next.running, next.last_turn) = (next.queued - 1, next.running + 1, turn);
        }
        assert_eq!(order, "abcababa");
    }

    #[test]
    fn owners_at_their_limit_of_running_jobs_are_skipped() {
        assert_eq!(next_owner(&[load("a", 5, 2, 0)], &CAPS), None);
        let loads = [load("a", 5, 2, 0), load("b", 1, 1, 9)];
        assert_eq!(next_owner(&loads, &CAPS), Some(&loads[1]));
        assert_eq!(next_owner(&[load("a", 0, 0, 0)], &CAPS), None);
        let nobody = [load("", 5, 200, 0)];
        assert_eq!(next_owner(&nobody, &CAPS), Some(&nobody[0]), "without keys there is no bound");
    }
}
