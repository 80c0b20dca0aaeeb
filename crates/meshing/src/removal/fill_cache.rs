//! The errors of the triangles that would fill the hole of a vertex, as last evaluated.
//!
//! When a neighbour is removed, two in five triangles of a vertex's hole stay the same, and when the
//! vertex itself is removed, all do: their errors need not be computed again. A triangle is known by
//! the indices of its vertices among the neighbours.

/// Triangles cached for each vertex; a hole has four on average.
pub(crate) const CACHED_TRIANGLES: usize = 6;

/// Stands for a triangle that is not cached.
const NONE: u32 = u32::MAX;

/// The triangles last evaluated for one vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FillCache {
    /// The indices of the vertices of each, ascending, a byte each.
    triangles: [u32; CACHED_TRIANGLES],
    errors: [u32; CACHED_TRIANGLES],
}

impl FillCache {
    /// No triangles.
    pub(crate) const EMPTY: Self =
        Self { triangles: [NONE; CACHED_TRIANGLES], errors: [0; CACHED_TRIANGLES] };

    /// Whether the error of a triangle is cached, and the error, or 0.
    #[inline(always)]
    pub(crate) fn error(&self, indices: [u8; 3]) -> (bool, u32) {
        let wanted = pack(indices);
        // All slots are compared, without a branch for each.
        let (mut is_cached, mut error) = (false, 0);
        for (&triangle, &cached) in self.triangles.iter().zip(&self.errors) {
            is_cached |= triangle == wanted;
            error |= if triangle == wanted { cached } else { 0 };
        }
        (is_cached, error)
    }

    /// Writes a triangle to a slot, if there is a slot of this number.
    #[inline(always)]
    pub(crate) fn set_triangle(&mut self, slot: usize, indices: [u8; 3]) {
        if let Some(triangle) = self.triangles.get_mut(slot) {
            *triangle = pack(indices);
        }
    }

    /// Writes the error of the triangle in a slot, if there is a slot of this number; an error that
    /// does not fit takes the triangle out.
    #[inline(always)]
    pub(crate) fn set_error(&mut self, slot: usize, error: u64) {
        if let (Some(triangle), Some(cached)) =
            (self.triangles.get_mut(slot), self.errors.get_mut(slot))
        {
            *triangle = if error > u32::MAX.into() { NONE } else { *triangle };
            *cached = error as u32;
        }
    }

    /// All triangles of a fill of `count`, and their errors; `None` when some of them are not cached.
    #[inline(always)]
    pub(crate) fn all(
        &self,
        count: usize,
    ) -> Option<(impl Iterator<Item = [u8; 3]>, [u32; CACHED_TRIANGLES])> {
        let cached = self.triangles.get(..count)?;
        let is_whole = !cached.contains(&NONE);
        is_whole.then(|| (cached.iter().map(|&triangle| unpack(triangle)), self.errors))
    }
}

/// Three indices as three bytes.
#[inline(always)]
fn pack([a, b, c]: [u8; 3]) -> u32 {
    u32::from_le_bytes([a, b, c, 0])
}

/// The three indices.
#[inline(always)]
fn unpack(triangle: u32) -> [u8; 3] {
    let [a, b, c, _] = triangle.to_le_bytes();
    [a, b, c]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_was_written() {
        let mut cache = FillCache::EMPTY;
        assert_eq!(cache.error([0, 1, 2]), (false, 0));
        let (triangles, errors) = ([[0, 2, 4], [2, 3, 4], [0, 1, 2]], [5, 0, 7]);
        for (slot, (triangle, error)) in triangles.into_iter().zip(errors).enumerate() {
            cache.set_triangle(slot, triangle);
            cache.set_error(slot, error);
        }
        assert_eq!(cache.error([0, 1, 2]), (true, 7));
        assert_eq!(cache.error([2, 3, 4]), (true, 0));
        assert_eq!(cache.error([1, 3, 4]), (false, 0));
        assert!(cache.all(3).unwrap().0.eq(triangles));
        assert!(cache.all(4).is_none() && cache.all(7).is_none());
        // Neither an error that does not fit nor a slot too many.
        cache.set_error(1, 1 << 32);
        assert!(!cache.error([2, 3, 4]).0 && cache.all(3).is_none());
        cache.set_triangle(CACHED_TRIANGLES, [6, 7, 8]);
        assert!(!cache.error([6, 7, 8]).0);
    }
}
