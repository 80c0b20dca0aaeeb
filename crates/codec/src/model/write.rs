//! The MODEL writer.

use pixmesh_meshing::Mesh;
use std::io::{self, Write};

/// Bytes that are collected before they are written.
const BUFFER_BYTES: usize = 1 << 16;

/// Writes a mesh as MODEL: the shape on the first line, `OFF` on the second, the numbers of
/// vertices, faces and edges on the third, then a line for each vertex and each face.
///
/// # Errors
/// Whatever `out` fails with.
pub fn write_model(mesh: &Mesh, out: &mut impl Write) -> io::Result<()> {
    write_model_with_comments(mesh, &[], out)
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
    let mut lines = Lines { out, buffer: Vec::with_capacity(BUFFER_BYTES) };
    let (components, precision) = (shape.component_count, usize::from(shape.precision));
    lines.write([shape.width, shape.height, components, precision])?;
    lines.buffer.extend_from_slice(b"OFF\n");
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        lines.buffer.extend_from_slice(b"# ");
        lines.buffer.extend_from_slice(line.as_bytes());
        lines.buffer.push(b'\n');
    }
    lines.write([mesh.points().len(), mesh.faces().len(), mesh.edge_count()])?;
    for (point, samples) in mesh.points().iter().zip(mesh.samples().chunks_exact(components)) {
        let place = [point.x, point.y].into_iter();
        lines.write(place.chain(samples.iter().map(|&sample| i32::from(sample))))?;
    }
    for &[i, j, k] in mesh.faces() {
        lines.write([3, i, j, k])?;
    }
    lines.flush()
}

/// Lines of numbers on their way out.
struct Lines<'a, W> {
    out: &'a mut W,
    buffer: Vec<u8>,
}

impl<W: Write> Lines<'_, W> {
    /// Writes a line of numbers, which are not none, with a blank between two.
    fn write<I: itoa::Integer>(&mut self, numbers: impl IntoIterator<Item = I>) -> io::Result<()> {
        let mut digits = itoa::Buffer::new();
        for number in numbers {
            self.buffer.extend_from_slice(digits.format(number).as_bytes());
            self.buffer.push(b' ');
        }
        if let Some(last) = self.buffer.last_mut() {
            *last = b'\n';
        }
        if self.buffer.len() > BUFFER_BYTES { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }
}
