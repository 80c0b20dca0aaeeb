//! Pictures of a few pixels and few grays, where many removals cost the same, against trying every
//! point at every step.
//!
//! The twin triangulates afresh for each point that it tries. Hence a picture of many pixels ends with
//! many points, and one of few or one that begins with few points goes down to whatever size the bytes
//! say: a run takes milliseconds.

use super::input::Input;
use super::twin::removal;
use super::twin::triangulation::{triangles_of, triangulate};
use pixmesh_meshing::{Image, Method, Parameters, Target, mesh_image, sample_points};

/// The most columns and rows.
const MOST: usize = 6;

/// The most points that the twin tries, of those which the size asked for makes it try.
const MOST_TRIED: usize = 100;

/// Makes the mesh of a picture, and the one of the twin.
pub fn run(bytes: &[u8]) {
    let mut input = Input(bytes);
    let (width, height) = (input.between(2, MOST), input.between(2, MOST));
    let (grays, size) = (input.between(1, 4) as u16, input.between(4, width * height));
    let choices = input.byte();
    let bad_point_removal = choices % 2 == 1;
    let method = if choices & 2 == 0 { Method::Mgpr } else { Method::Mgprfs };
    let samples = (0..width * height).map(|_| u16::from(input.byte()) % (grays + 1) * 50).collect();
    let image =
        Image::from_bottom_up(width, height, 8, vec![samples]).expect("a picture of few grays");
    for size in size..=width * height {
        let own = method.parameters(Target::Size(size));
        let parameters = own.bad_point_removal(bad_point_removal);
        let plan = parameters.plan(image.shape()).expect("a size that fits");
        if tried(plan.initial_size, plan.size) <= MOST_TRIED {
            return check(&image, &parameters);
        }
    }
}

/// Points that are tried on the way from one size to another, the corners not among them.
fn tried(from: usize, to: usize) -> usize {
    (to..from).map(|removed| removed + 1 - 4).sum()
}

fn check(image: &Image, parameters: &Parameters) {
    let made = mesh_image(image, parameters, &()).expect("a size that fits");
    let initial = sample_points(image, parameters, made.plan.initial_size, &());
    let initial = initial.expect("nobody cancels");
    let is_trimmed = made.plan.initial_size > made.plan.size || parameters.bad_point_removal;
    let expected =
        if is_trimmed { removal::simplify(image, initial, made.plan, parameters) } else { initial };
    assert_eq!(made.mesh.points(), expected, "{parameters:?}");
    let faces = triangles_of(made.mesh.points(), made.mesh.faces());
    assert_eq!(faces, triangulate(&expected));
}
