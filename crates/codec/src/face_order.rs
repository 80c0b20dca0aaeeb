//! Faces in an order in which neighbours follow each other, and vertices in that of their first use.

use pixmesh_meshing::{Face, Mesh};

/// No face, or no vertex yet.
const NONE: u32 = u32::MAX;

/// The same mesh with its faces in the order of a walk from neighbour to neighbour, and its vertices
/// in the order in which the faces name them first.
///
/// The walk goes on over the edge that was entered last and has a face left beyond it, so that each
/// face shares an edge with one shortly before.
pub(crate) fn by_neighbours(mesh: &Mesh) -> Mesh {
    let neighbours = neighbours(mesh.faces());
    let (faces, face_order) = walk(mesh.faces(), &neighbours);
    drop(neighbours);
    let mut place = vec![NONE; mesh.points().len()];
    let mut order = Vec::with_capacity(mesh.points().len());
    let mut renumbered = |vertex: u32| {
        let place = &mut place[vertex as usize];
        if *place == NONE {
            *place = order.len() as u32;
            order.push(vertex as usize);
        }
        *place
    };
    let faces = faces.into_iter().map(|face| face.map(&mut renumbered)).collect();
    let points = order.iter().map(|&vertex| mesh.points()[vertex]).collect();
    let samples = order.iter().flat_map(|&vertex| mesh.vertex_samples(vertex).to_vec()).collect();
    let count = mesh.shape().component_count;
    let of_face = |samples: &[u16]| {
        face_order.iter().flat_map(|&face| samples[face * count..][..count].to_vec()).collect()
    };
    // A valid mesh in another order is valid.
    let ordered = Mesh::new(mesh.shape(), points, samples, faces, &());
    let ordered = ordered.and_then(|ordered| match mesh.face_samples() {
        Some(samples) => ordered.with_face_samples(of_face(samples)),
        None => Ok(ordered),
    });
    ordered.unwrap_or_else(|_| mesh.clone())
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
    use pixmesh_meshing::{Point, Shape};
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
        let ordered = by_neighbours(&mesh);
        let set = |mesh: &Mesh| -> BTreeSet<Vec<(i32, i32, u16)>> {
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
