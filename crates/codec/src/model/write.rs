//! The MODEL writer.

use super::read::FACE_SAMPLES;
use crate::lines::Lines;
use pixmesh_meshing::parameters::{Connectivity, Values};
use pixmesh_meshing::{Mesh, Parameters};
use std::io::{self, Write};

/// Writes a mesh as MODEL: the shape on the first line, `OFF` on the second, the numbers of
/// vertices, faces and edges on the third, then a line for each vertex and each face. Colours of
/// faces follow as comments, which other readers skip: `# face samples: `, the number of faces, and
/// a comment with the samples of each face. Colours are straight where there is alpha.
///
/// # Errors
/// Whatever `out` fails with.
pub fn write_model(mesh: &Mesh, out: &mut impl Write) -> io::Result<()> {
    write_model_with_comments(mesh, &[], out)
}

/// What distinguishes a mesh of these parameters from one of the thesis, as comments.
#[must_use]
pub fn model_comments(parameters: &Parameters) -> Vec<&'static str> {
    let free = "connectivity free: the faces need not be those of the Delaunay triangulation";
    let fitted = "values fitted: the values need not be the image's samples";
    let free = (parameters.connectivity == Connectivity::Free).then_some(free);
    let fitted = (parameters.values == Values::Fitted).then_some(fitted);
    free.into_iter().chain(fitted).collect()
}

/// Writes a mesh as [`write_model`] does, with comments, one line each, after the word `OFF`.
///
/// # Errors
/// Whatever `out` fails with.
pub fn write_model_with_comments(
    mesh: &Mesh,
    comments: &[&str],
    out: &mut impl Write,
) -> io::Result<()> {
    let shape = mesh.shape();
    let (vertices, of_faces) = (mesh.straight_samples(), mesh.straight_face_samples());
    let mut lines = Lines::new(out);
    let (components, precision) = (shape.component_count, usize::from(shape.precision));
    put_line([shape.width, shape.height, components, precision], &mut lines)?;
    lines.end("OFF\n")?;
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        lines.text("# ");
        lines.text(line);
        lines.end("\n")?;
    }
    put_line([mesh.points().len(), mesh.faces().len(), mesh.edge_count()], &mut lines)?;
    for (point, samples) in mesh.points().iter().zip(vertices.chunks_exact(components)) {
        let place = [point.x, point.y].into_iter();
        put_line(place.chain(samples.iter().map(|&sample| i32::from(sample))), &mut lines)?;
    }
    for &[i, j, k] in mesh.faces() {
        put_line([3, i, j, k], &mut lines)?;
    }
    if let Some(samples) = of_faces {
        lines.text("# ");
        lines.text(FACE_SAMPLES);
        lines.text(" ");
        put_line([mesh.faces().len()], &mut lines)?;
        for samples in samples.chunks_exact(components) {
            lines.text("# ");
            put_line(samples.iter().copied(), &mut lines)?;
        }
    }
    lines.flush()
}

/// Writes a line of numbers, with a blank between two.
fn put_line<I: itoa::Integer, W: Write>(
    numbers: impl IntoIterator<Item = I>,
    lines: &mut Lines<'_, W>,
) -> io::Result<()> {
    let mut separator = "";
    for number in numbers {
        lines.text(separator);
        lines.integer(number);
        separator = " ";
    }
    lines.end("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_meshing::{Method, Target};

    #[test]
    fn comments_name_each_departure_from_the_thesis() {
        let plain = Method::Optimal.parameters(Target::Size(50));
        assert_eq!(model_comments(&plain), [] as [&str; 0]);
        let free = plain.clone().connectivity(Connectivity::Free);
        let fitted = plain.values(Values::Fitted);
        for (parameters, word) in [(&free, "connectivity"), (&fitted, "values")] {
            let comments = model_comments(parameters);
            assert!(comments.len() == 1 && comments[0].contains(word), "{comments:?}");
        }
        assert_eq!(model_comments(&free.values(Values::Fitted)).len(), 2);
    }
}
