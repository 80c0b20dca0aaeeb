//! Greedy removal with a bound on the error of every sample.
//!
//! The order of greedy removal does not depend on where it ends. So the removals are made once
//! without the bound, and then repeated on a mesh that counts the faces that break the bound; they
//! end before the first removal that makes such a face.

use crate::control::{Cancelled, Control, Poller, Stage};
use crate::dynamic_mesh::MeasuredMesh;
use crate::face_error::FaceMeasure;
use crate::face_error::scan_conversion::{Interpolant, try_for_each_row};
use crate::image::{Image, Point};
use crate::removal::Removal;

/// How many of `removals`, in order, can be made on the mesh of an image before a sample of the
/// approximation differs from the image's by more than `most`.
pub(crate) fn removals_within(
    image: &Image,
    points: Vec<Point>,
    removals: &[Removal],
    most: u16,
    control: &dyn Control,
) -> Result<usize, Cancelled> {
    let numbers: Vec<usize> =
        removals.iter().filter_map(|removal| points.binary_search(&removal.point).ok()).collect();
    let violations = Violations { image, most };
    let mut mesh = MeasuredMesh::new(points, image.sides(), violations, Stage::Measure, control)?;
    let poller = &mut Poller::new(control, Stage::Measure, 0, numbers.len());
    for (made, &vertex) in numbers.iter().enumerate() {
        poller.done = made;
        poller.poll()?;
        if mesh.triangulation.total_error > 0 || mesh.remove(vertex as u32, poller)? > 0 {
            return Ok(made);
        }
    }
    Ok(numbers.len())
}

/// Counts the faces that hold a sample of too large an error.
#[derive(Clone)]
struct Violations<'a> {
    image: &'a Image,
    most: u16,
}

impl FaceMeasure for Violations<'_> {
    /// 1 for a face that breaks the bound, 0 for one that keeps it.
    fn error(&mut self, corners: [Point; 3], poller: &mut Poller<'_>) -> Result<u64, Cancelled> {
        let image = self.image;
        let mut approximation = Vec::new();
        let mut breaks = false;
        for (c, _) in image.components().iter().enumerate() {
            let samples = corners.map(|p| image.sample(c, p.x as usize, p.y as usize));
            let interpolant = Interpolant::new(corners, samples);
            try_for_each_row(corners, |y, first, end| {
                poller.step((end - first) as usize)?;
                let original = &image.row(c, y as usize)[first as usize..end as usize];
                approximation.resize(original.len(), 0);
                interpolant.fill(first, y, &mut approximation);
                let mut pairs = original.iter().zip(&approximation);
                breaks |= pairs.any(|(a, b)| a.abs_diff(*b) > self.most);
                Ok(())
            })?;
        }
        Ok(breaks.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::mesh::Mesh;
    use crate::model::rasterize::rasterize;
    use crate::parameters::choices::Parallel;
    use crate::removal::tests::{lattice, simplify};
    use crate::triangulation::Triangulation;

    /// The largest difference of a sample in the mesh of some points.
    fn largest(image: &Image, points: &[Point]) -> u16 {
        let triangulation = Triangulation::new(points.to_vec(), &()).unwrap();
        let faces = triangulation.faces(&()).unwrap();
        let mesh = Mesh::of_samples(image, points.to_vec(), faces, &()).unwrap();
        let rebuilt = rasterize(&mesh, &()).unwrap();
        let samples = image.components().concat().into_iter().zip(rebuilt.components().concat());
        samples.map(|(a, b)| a.abs_diff(b)).max().unwrap()
    }

    #[test]
    fn stops_before_the_first_broken_bound() {
        let side = 9;
        let plane = |c: usize| (0..side * side).map(|i| (i * i * (c + 3) % 41) as u16).collect();
        let image = Image::from_bottom_up(side, side, 8, vec![plane(0), plane(1)]).unwrap();
        let lattice = lattice(side, side);
        let removals = simplify(&image, 4, Parallel::Exact).removals;
        // The largest differences after none of the removals, after one, and so on.
        let mut points = lattice.clone();
        let mut differences = vec![0];
        for removal in &removals {
            points.retain(|&point| point != removal.point);
            differences.push(largest(&image, &points));
        }
        for most in 0..45 {
            let expected = differences.iter().position(|&difference| difference > most);
            let expected = expected.map_or(removals.len(), |first| first - 1);
            let within = removals_within(&image, lattice.clone(), &removals, most, &());
            assert_eq!(within, Ok(expected), "{most}");
        }
        // Meshes that break the bound before any removal, one of them more than after it.
        let corners = [(0, 0), (8, 0), (4, 4), (0, 8), (8, 8)].map(|(x, y)| Point::new(x, y));
        let removal = Removal { point: Point::new(4, 4), change: 0 };
        let sample = |i| if i == 4 * side + 4 { 40 } else { 0 };
        let peak =
            Image::from_bottom_up(side, side, 8, vec![(0..side * side).map(sample).collect()])
                .unwrap();
        for image in [&image, &peak] {
            let points = corners.to_vec();
            let within = removals_within(image, points, &[removal], 1, &());
            assert_eq!(within, Ok(0));
        }
    }
}
