//! Faces in an order in which neighbours follow each other, and vertices in that of their first use.

use crate::shown::Shown;
use pixmesh_meshing::Face;

/// No face, or no vertex yet.
const NONE: u32 = u32::MAX;

/// The same mesh with its faces in the order of a walk from neighbour to neighbour, and its vertices
/// in the order in which the faces name them first.
///
/// The walk goes on over the edge that was entered last and has a face left beyond it, so that each
/// face shares an edge with one shortly before.
pub(crate) fn by_neighbours<'a>(mesh: &Shown<'a>) -> Shown<'a> {
    let (faces, order) = walk(mesh.faces(), &neighbours(mesh.faces()));
    let mut turned = faces.into_iter();
    mesh.with_faces(&order, |face| turned.next().unwrap_or(face))
}

/// The face beyond each edge of each face; edge `i` runs from corner `i` to the next.
fn neighbours(faces: &[Face]) -> Vec<Face> {
    let mut edges: Vec<(u32, u32, u32, u8)> = Vec::with_capacity(3 * faces.len());
    for (index, &[a, b, c]) in faces.iter().enumerate() {
        for (side, (from, to)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
            edges.push((from.min(to), from.max(to), index as u32, side as u8));
        }
    }
    edges.sort_unstable();
    let mut neighbours = vec![[NONE; 3]; faces.len()];
    for pair in edges.windows(2) {
        let [(a, b, first, first_side), (c, d, second, second_side)] = [pair[0], pair[1]];
        if (a, b) == (c, d) {
            neighbours[first as usize][usize::from(first_side)] = second;
            neighbours[second as usize][usize::from(second_side)] = first;
        }
    }
    neighbours
}

/// All faces, each beginning with the edge over which it was entered, and their former indices.
fn walk(faces: &[Face], neighbours: &[Face]) -> (Vec<Face>, Vec<usize>) {
    let mut seen = vec![false; faces.len()];
    let mut ordered = Vec::with_capacity(faces.len());
    let mut order = Vec::with_capacity(faces.len());
    let mut waiting: Vec<(u32, u32)> = Vec::new();
    for first in 0..faces.len() as u32 {
        waiting.push((first, NONE));
        while let Some((index, from)) = waiting.pop() {
            if std::mem::replace(&mut seen[index as usize], true) {
                continue;
            }
            let (mut face, mut beyond) = (faces[index as usize], neighbours[index as usize]);
            let entered = beyond.iter().position(|&other| other == from && from != NONE);
            face.rotate_left(entered.unwrap_or(0));
            beyond.rotate_left(entered.unwrap_or(0));
            ordered.push(face);
            order.push(index as usize);
            let [first, second, third] = beyond;
            // Only the first face of a walk has a face left beyond its first edge.
            let first = if entered.is_none() { first } else { NONE };
            let others = [second, third, first].into_iter().filter(|&other| other != NONE);
            waiting.extend(others.map(|other| (other, index)));
        }
    }
    (ordered, order)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_meshing::{Mesh, Point, Shape};
    use std::collections::BTreeSet;

    #[test]
    fn the_mesh_stays_the_same_and_neighbours_follow_each_other() {
        let side = 30_u32;
        let shape = Shape { width: 30, height: 30, component_count: 1, precision: 16 };
        let points: Vec<Point> =
            (0..900).map(|i| Point::new((i * 7 % 900) % 30, (i * 7 % 900) / 30)).collect();
        let at = |x: u32, y: u32| {
            let place = Point::new(x as i32, y as i32);
            points.iter().position(|&point| point == place).unwrap() as u32
        };
        let cells = (0..side - 1).flat_map(|y| (0..side - 1).map(move |x| (x, y)));
        let faces: Vec<Face> = cells
            .flat_map(|(x, y)| {
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                [[a, b, c], [c, d, a]]
            })
            .collect();
        let mesh = Mesh::new(shape, points, (0..900).collect(), faces, &()).unwrap();
        let mesh = Shown::new(&mesh, false, false);
        let ordered = by_neighbours(&mesh);
        let set = |mesh: &Shown<'_>| -> BTreeSet<Vec<(i32, i32, u16)>> {
            let corner = |v: u32| {
                let point = mesh.points()[v as usize];
                (point.x, point.y, mesh.vertex_samples(v as usize)[0])
            };
            let sorted = |face: &Face| {
                let mut corners = face.map(corner).to_vec();
                corners.sort_unstable();
                corners
            };
            mesh.faces().iter().map(sorted).collect()
        };
        assert_eq!(set(&ordered), set(&mesh));
        let shared = ordered
            .faces()
            .windows(2)
            .filter(|pair| pair[0].iter().filter(|&vertex| pair[1].contains(vertex)).count() == 2);
        assert!(shared.count() > 1500);
    }
}
