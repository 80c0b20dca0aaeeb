//! The lines of the tables as data: the name that the thesis prints, and the parameters behind it.

use pixmesh_meshing::parameters::{Generator, Guide, InitialSize, Policy, Startup};
use pixmesh_meshing::{Method, Parameters, Shape, Target};

/// The densities of every table, in percent.
pub const DENSITIES: [f64; 5] = [0.5, 1.0, 2.0, 3.0, 4.0];

/// The policies for pictures of several components that the thesis compares, in its order.
pub const POLICIES: [Policy; 9] = [
    Policy::PsbD,
    Policy::PsbL,
    Policy::Psc,
    Policy::PsdMaxD,
    Policy::PsdMaxL,
    Policy::PsdAvgD,
    Policy::PsdAvgL,
    Policy::PseD,
    Policy::PseL,
];

/// A method with a name, for images of one number of components, at any density.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The name, as the thesis has it.
    pub label: String,
    /// Components of the images, 1 or 3.
    pub components: usize,
    /// Everything but the density.
    parameters: Parameters,
}

/// One mesh to be made of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Components of the image, 1 or 3.
    pub components: usize,
    /// What distinguishes the parameters, in words: the same for the same mesh.
    pub code: String,
    /// The parameters.
    pub parameters: Parameters,
}

impl Series {
    /// A method of Chapter 4.
    #[must_use]
    pub fn method(method: Method, components: usize) -> Self {
        let parameters = method.parameters(Target::Percent(100.0));
        Self::new(method.name().to_uppercase(), components, parameters)
    }

    /// Error diffusion with a policy, and no simplification.
    #[must_use]
    pub fn ed_like(policy: Policy, startup: Startup) -> Self {
        Self::with_policy("ED-like", Method::Med, policy, startup)
    }

    /// Error diffusion with a policy to four times the points, then greedy point removal.
    #[must_use]
    pub fn gprfsed_like(policy: Policy, startup: Startup) -> Self {
        Self::with_policy("GPRFSED-like", Method::Mgprfs, policy, startup)
    }

    /// The same method, simplified by the error of all components even where the published
    /// figures are simplified by that of the luma.
    #[must_use]
    pub fn on_colours(self) -> Self {
        let label = format!("{} (on the colours)", self.label);
        let parameters = self.parameters.guide(Guide::Components);
        Self { label, parameters, ..self }
    }

    /// A method of Chapter 3: one of Chapter 4 with another policy and start-up.
    fn with_policy(like: &str, method: Method, policy: Policy, startup: Startup) -> Self {
        let guide = match policy {
            Policy::PsbD | Policy::PsbL => Guide::Luma,
            _ => Guide::Components,
        };
        let start = match startup {
            Startup::Classic => "classic",
            Startup::Mirroring => "mirror",
            Startup::Random => "random",
        };
        let parameters = method.parameters(Target::Percent(100.0));
        Self::new(
            format!("{like} {} {start}", policy_label(policy)),
            if matches!(policy, Policy::PsaD | Policy::PsaL) { 1 } else { 3 },
            parameters.policy(policy).startup(startup).guide(guide),
        )
    }

    /// A series in the one form that the same parameters have under all their names.
    fn new(label: String, components: usize, mut parameters: Parameters) -> Self {
        if components == 1 && parameters.policy == Policy::PsdMaxD {
            // The maximum over one component.
            parameters.policy = Policy::PsaD;
        }
        Self { label, components, parameters }
    }

    /// Tells whether points are removed from an initial mesh.
    #[must_use]
    pub fn simplifies(&self) -> bool {
        self.parameters.initial_size != InitialSize::Target
    }

    /// The mesh of this method at a density, in percent.
    #[must_use]
    pub fn case(&self, density: f64) -> Case {
        let target = Target::Percent(density);
        let parameters = self.parameters.clone().target(target);
        Case { components: self.components, code: code(&parameters, density), parameters }
    }
}

impl Case {
    /// Points that the mesh starts with, a measure of the work; 0 where the parameters do not
    /// suit the image.
    #[must_use]
    pub fn initial_size(&self, shape: Shape) -> usize {
        self.parameters.plan(shape).map_or(0, |plan| plan.initial_size)
    }
}

/// What distinguishes the parameters of two cases; all others are those of every method.
fn code(parameters: &Parameters, density: f64) -> String {
    let Parameters { generator, policy, startup, guide, .. } = parameters;
    let points = match (generator, parameters.initial_size) {
        (Generator::ErrorDiffusion, InitialSize::Target) => format!("{policy} {startup}"),
        (Generator::ErrorDiffusion, size) => format!("{policy} {startup} {size:?}"),
        (generator, _) => generator.to_string(),
    };
    format!("{points} {guide} {density}")
}

/// A policy's name in the thesis.
fn policy_label(policy: Policy) -> &'static str {
    match policy {
        Policy::PsaD => "PSA(D)",
        Policy::PsaL => "PSA(L)",
        Policy::PsbD => "PSB(D)",
        Policy::PsbL => "PSB(L)",
        Policy::Psc => "PSC",
        Policy::PsdMaxD => "PSD(Max,D)",
        Policy::PsdMaxL => "PSD(Max,L)",
        Policy::PsdAvgD => "PSD(Avg,D)",
        Policy::PsdAvgL => "PSD(Avg,L)",
        Policy::PseD => "PSE(D)",
        Policy::PseL => "PSE(L)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_mesh_has_the_same_code_under_all_its_names() {
        let code = |series: Series| series.case(2.0).code;
        let (classic, mirror) = (Startup::Classic, Startup::Mirroring);
        for (one, other) in [
            (Series::method(Method::Ced, 3), Series::ed_like(Policy::PsbD, classic)),
            (Series::method(Method::Med, 3), Series::ed_like(Policy::PsdMaxD, mirror)),
            (Series::method(Method::Mgprfs, 3), Series::gprfsed_like(Policy::PsdMaxD, mirror)),
            (Series::method(Method::Cgprfsed, 3), Series::gprfsed_like(Policy::PsbD, classic)),
            (Series::method(Method::Ed, 1), Series::ed_like(Policy::PsaD, classic)),
            (Series::method(Method::Med, 1), Series::ed_like(Policy::PsaD, mirror)),
            (Series::method(Method::Gprfsed, 1), Series::gprfsed_like(Policy::PsaD, classic)),
            (Series::method(Method::Mgprfs, 1), Series::gprfsed_like(Policy::PsaD, mirror)),
        ] {
            assert_eq!(code(one), code(other));
        }
        let psb = Series::gprfsed_like(Policy::PsbD, mirror);
        assert_ne!(code(psb.clone()), code(psb.clone().on_colours()));
        assert_ne!(psb.case(1.0).code, psb.case(2.0).code);
        assert_ne!(code(Series::method(Method::Cgpr, 3)), code(Series::method(Method::Mgpr, 3)));
    }

    #[test]
    fn labels_are_those_of_the_published_figures() {
        let label = Series::gprfsed_like(Policy::PsdAvgL, Startup::Mirroring).label;
        assert_eq!(label, "GPRFSED-like PSD(Avg,L) mirror");
        assert_eq!(Series::method(Method::Cgprfsed, 3).label, "CGPRFSED");
    }
}
