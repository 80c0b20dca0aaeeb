//! How much work there is to do, in units whose seconds are learned, one kind of work apart from
//! the other.

use pixmesh_codec::Header;
use pixmesh_meshing::parameters::Plan;
use pixmesh_meshing::{Parameters, Shape};

/// Samples that are decoded and filtered in about the time in which one point is removed.
const SAMPLES_PER_REMOVAL: f64 = 100.0;

/// Removals that take about as long as the refinement of one vertex of the mesh, by effort.
const REMOVALS_PER_REFINED: [f64; 10] = [0.0, 4.0, 6.0, 8.0, 12.0, 15.0, 22.0, 32.0, 44.0, 80.0];

/// Kinds of work whose units take different times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WorkKind {
    /// One mesh of the points chosen: its unit is a sample of the image.
    OneShot,
    /// Points are removed from the first mesh: its unit is a point to remove.
    Simplifying,
}

impl WorkKind {
    /// Every kind, in the order of their declaration.
    pub(crate) const ALL: [Self; 2] = [Self::OneShot, Self::Simplifying];

    /// Seconds per unit that are assumed before any work was measured.
    pub(crate) fn first_guess_s(self) -> f64 {
        match self {
            Self::OneShot => 1e-7,
            Self::Simplifying => 5e-6,
        }
    }
}

/// An amount of work of one kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Effort {
    pub(crate) kind: WorkKind,
    /// Over 0.
    pub(crate) units: f64,
}

impl Effort {
    /// That of work that looks at each sample a few times, and at nothing else for long.
    pub(crate) fn of_samples(shape: Shape) -> Self {
        let Shape { width, height, component_count, .. } = shape;
        Self { kind: WorkKind::OneShot, units: (width * height * component_count) as f64 }
    }

    /// That of meshing an image of this header by this plan: for a one-shot mesh the image's
    /// samples, else the points to remove and, as so many more, the samples.
    pub(crate) fn of_mesh(header: &Header, plan: &Plan, parameters: &Parameters) -> Self {
        let samples = (header.width * header.height * header.component_count) as f64;
        if !parameters.simplifies(plan) {
            return Self { kind: WorkKind::OneShot, units: samples };
        }
        let removals = plan.initial_size.saturating_sub(plan.size) as f64;
        let refined = plan.size as f64 * REMOVALS_PER_REFINED[usize::from(parameters.effort)];
        let units = removals + refined + samples / SAMPLES_PER_REMOVAL;
        Self { kind: WorkKind::Simplifying, units }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_codec::PictureFormat;
    use pixmesh_meshing::{Method, Target};

    fn effort(method: Method, target: Target) -> Effort {
        let header = Header {
            format: PictureFormat::Png,
            width: 100,
            height: 100,
            component_count: 1,
            precision: 8,
        };
        let parameters = method.parameters(target);
        let plan = parameters.plan(header.shape()).unwrap();
        Effort::of_mesh(&header, &plan, &parameters)
    }

    #[test]
    fn simplifying_is_counted_in_points_and_one_shot_work_in_samples() {
        let one_shot = effort(Method::Med, Target::Size(500));
        assert_eq!(one_shot, Effort { kind: WorkKind::OneShot, units: 10_000.0 });
        let simplifying = effort(Method::Mgpr, Target::Size(500));
        assert_eq!(simplifying, Effort { kind: WorkKind::Simplifying, units: 9_600.0 });
        assert!(effort(Method::Mgprfs, Target::Size(500)).units < simplifying.units);
        assert!(effort(Method::Mgprfs, Target::Psnr(30.0)).units > simplifying.units);
    }
}
