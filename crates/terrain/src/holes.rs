//! Heights in the place of missing ones.

/// Fills the samples that are missing, of rows of `width`: each becomes the mean of its neighbours
/// that are known or filled already, ring by ring from the borders of the holes. All are missing or
/// none is left so.
///
/// ```
/// use pixmesh_terrain::filled;
/// let samples = [Some(4), None, None, Some(8)];
/// assert_eq!(filled(&samples, 4), [4, 4, 8, 8]);
/// ```
#[must_use]
pub fn filled(samples: &[Option<u16>], width: usize) -> Vec<u16> {
    let mut made = samples.to_vec();
    let neighbours = |i: usize| {
        let column = i % width;
        let across = [(column > 0).then(|| i - 1), (column + 1 < width).then(|| i + 1)];
        let along = [i.checked_sub(width), Some(i + width).filter(|&i| i < samples.len())];
        across.into_iter().chain(along).flatten()
    };
    let mut ring: Vec<usize> = (0..made.len())
        .filter(|&i| made[i].is_none() && neighbours(i).any(|n| samples[n].is_some()))
        .collect();
    let mut is_listed: Vec<bool> = samples.iter().map(Option::is_some).collect();
    ring.iter().for_each(|&i| is_listed[i] = true);
    while !ring.is_empty() {
        let mean = |i: usize| {
            let known = neighbours(i).filter_map(|n| made[n]).map(u32::from);
            let (sum, count) = known.fold((0, 0), |(sum, count), n| (sum + n, count + 1));
            ((2 * sum + count) / (2 * count).max(1)) as u16
        };
        let means: Vec<u16> = ring.iter().map(|&i| mean(i)).collect();
        let mut next = Vec::new();
        for (&i, mean) in ring.iter().zip(means) {
            made[i] = Some(mean);
            next.extend(neighbours(i).filter(|&n| !std::mem::replace(&mut is_listed[n], true)));
        }
        ring = next;
    }
    made.into_iter().map(Option::unwrap_or_default).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn known_samples_stay_and_others_lie_between_them(
            width in 1usize..8,
            samples in prop::collection::vec(prop::option::weighted(0.3, 5u16..90), 1..64),
        ) {
            let samples = &samples[..samples.len() / width * width];
            prop_assume!(samples.iter().any(Option::is_some));
            let known: Vec<u16> = samples.iter().copied().flatten().collect();
            let range = *known.iter().min().unwrap()..=*known.iter().max().unwrap();
            for (made, sample) in filled(samples, width).into_iter().zip(samples) {
                prop_assert!(range.contains(&made));
                prop_assert!(sample.is_none_or(|sample| sample == made));
            }
        }
    }
}
