//! A mesh as the buffers that a GPU draws.

use crate::image::{Point, Shape};
use crate::model::mesh::Mesh;

/// The vertex and index buffers of a mesh. Where the faces have
/// [samples](Mesh::face_samples), each face has three vertices of its own in its colour.
///
/// ```
/// use pixmesh_meshing::{Buffers, Image, Method, Target, mesh_image};
///
/// let image = Image::from_top_down(2, 2, 8, vec![vec![0, 255, 255, 0]])?;
/// let mesh = mesh_image(&image, &Method::Med.parameters(Target::Size(4)), &())?.mesh;
/// let Buffers { positions, colors, indices, .. } = Buffers::new(&mesh);
/// assert_eq!((positions[0], colors[0]), ([0.0, 0.0, 0.0], [255, 255, 255, 255]));
/// assert_eq!(indices.len(), 3 * mesh.faces().len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Buffers {
    /// `x`, `y` and 0 for each vertex, in pixels: `y` grows upwards, and (0, 0) is the centre of
    /// the image's bottom left pixel. The vertex format `Float32x3` of WebGPU.
    pub positions: Vec<[f32; 3]>,
    /// Red, green, blue and alpha for each vertex, 0 to 255, encoded as the samples are, which is
    /// sRGB in most pictures: `Unorm8x4`. One component is gray, two are gray and alpha, three
    /// are RGB, four RGBA; of more than four the first three count. Colours are straight.
    pub colors: Vec<[u8; 4]>,
    /// Coordinates of each vertex in the image as a texture: 0 to 1, `v` downwards from the top
    /// edge as in WebGPU and glTF: `Float32x2`.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertices for each face, counter-clockwise: `Uint32`.
    pub indices: Vec<u32>,
}

impl Buffers {
    /// The buffers of a mesh.
    #[must_use]
    pub fn new(mesh: &Mesh) -> Self {
        let Shape { width, height, component_count, precision } = mesh.shape();
        let largest = crate::image::largest_sample(precision);
        let count = component_count;
        let (straight, of_faces) = (mesh.straight_samples(), mesh.straight_face_samples());
        let (vertices, samples, indices): (Vec<u32>, Vec<&[u16]>, Vec<u32>) = match &of_faces {
            None => (
                (0..mesh.points().len() as u32).collect(),
                straight.chunks_exact(count).collect(),
                mesh.faces().as_flattened().to_vec(),
            ),
            Some(samples) => (
                mesh.faces().as_flattened().to_vec(),
                samples.chunks_exact(count).flat_map(|samples| [samples; 3]).collect(),
                (0..3 * mesh.faces().len() as u32).collect(),
            ),
        };
        let points: Vec<Point> = vertices.iter().map(|&v| mesh.points()[v as usize]).collect();
        let [columns, rows] = [width, height].map(|side| side as f32);
        let uv = |x: i32, y: i32| [(x as f32 + 0.5) / columns, (rows - y as f32 - 0.5) / rows];
        Self {
            positions: points.iter().map(|p| [p.x as f32, p.y as f32, 0.0]).collect(),
            colors: samples.iter().map(|samples| color(samples, largest)).collect(),
            uvs: points.iter().map(|p| uv(p.x, p.y)).collect(),
            indices,
        }
    }
}

fn color(samples: &[u16], largest: u16) -> [u8; 4] {
    let scaled = |&sample: &u16| {
        let largest = u32::from(largest);
        ((510 * u32::from(sample) + largest) / (2 * largest)) as u8
    };
    match samples {
        [gray] => [scaled(gray), scaled(gray), scaled(gray), u8::MAX],
        [gray, alpha] => [scaled(gray), scaled(gray), scaled(gray), scaled(alpha)],
        [r, g, b, alpha] => [r, g, b, alpha].map(scaled),
        [r, g, b, ..] => [scaled(r), scaled(g), scaled(b), u8::MAX],
        [] => [u8::MAX; 4],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Point;

    #[test]
    fn vertices_lie_at_pixel_centres() {
        let shape = Shape { width: 5, height: 4, component_count: 3, precision: 4 };
        let points = [(0, 0), (4, 0), (0, 3), (4, 3)].map(|(x, y)| Point::new(x, y)).to_vec();
        let samples = vec![15, 0, 7, 0, 0, 0, 15, 15, 15, 1, 2, 3];
        let mesh = Mesh::new(shape, points, samples, vec![[0, 1, 3], [0, 3, 2]], &()).unwrap();
        let buffers = Buffers::new(&mesh);
        assert_eq!(buffers.positions[3], [4.0, 3.0, 0.0]);
        assert_eq!(buffers.colors[0], [255, 0, 119, 255]);
        assert_eq!(buffers.colors[3], [17, 34, 51, 255]);
        assert_eq!((buffers.uvs[0], buffers.uvs[3]), ([0.1, 0.875], [0.9, 0.125]));
        assert_eq!(buffers.indices, [0, 1, 3, 0, 3, 2]);
    }

    #[test]
    fn component_counts_choose_gray_rgb_and_alpha() {
        let colors = [&[9][..], &[9, 4], &[9, 4, 7], &[9, 4, 7, 2], &[9, 4, 7, 2, 1]];
        assert_eq!(
            colors.map(|samples| color(samples, 255)),
            [[9, 9, 9, 255], [9, 9, 9, 4], [9, 4, 7, 255], [9, 4, 7, 2], [9, 4, 7, 255]]
        );
        assert_eq!(color(&[u16::MAX, 0], u16::MAX), [255, 255, 255, 0]);
    }
}
