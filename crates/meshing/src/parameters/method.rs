//! The methods as data: the sets of parameters that the thesis names, and four beyond it.
//!
//! "Effective Techniques for Generating Delaunay Mesh Models of Single- and Multi-Component
//! Images" (thesis, University of Victoria) describes one framework: a policy turns the image
//! into a density, error diffusion picks initial points of that density, and greedy point removal
//! simplifies their triangulation. A [`Method`] is a named set of [`Parameters`].

use crate::parameters::choices::{
    Generator, Guide, Parallel, Policy, Reconstruction, Startup, named_values,
};
use crate::parameters::{
    DEFAULT_EFFORT, FLAT_EFFORT, InitialSize, ParameterError, Parameters, Target, check_count,
};

named_values! {
    /// The named methods.
    "method" Method {
        /// Error diffusion of one component with classic start-up; no simplification.
        Ed = "ed",
        /// Modified error diffusion of any number of components; no simplification: fast.
        Med = "med",
        /// MED, then the points that only raise the error are removed: better, with fewer points.
        MedPlus = "med+",
        /// Error diffusion of one component to 4 times the points, then greedy point removal.
        Gprfsed = "gprfsed",
        /// Modified error diffusion of any number of components to 4 times the points, then greedy
        /// point removal: good.
        Mgprfs = "mgprfs",
        /// MGPRFS, then refinement: vertices move and change places while that lowers the error, as
        /// long as the effort says: best.
        Optimal = "optimal",
        /// Points removed, then refined, by the error of the best single colour of each face.
        Flat = "flat",
        /// Greedy point removal from all lattice points, one component.
        Gpr = "gpr",
        /// Greedy point removal from all lattice points, any number of components.
        Mgpr = "mgpr",
        /// ED on the luma of three components, whose colours the mesh then carries.
        Ced = "ced",
        /// GPRFSED on the luma of three components, whose colours the mesh then carries.
        Cgprfsed = "cgprfsed",
        /// GPR on the gray picture of three components, whose colours the mesh then carries.
        Cgpr = "cgpr",
        /// Points inserted one by one where the error is largest, any number of components; no
        /// simplification: a first sight in less than a tenth of a second.
        Preview = "preview",
    }
}

impl Method {
    /// The parameters that define this method, for a target.
    #[must_use]
    pub fn parameters(self, target: Target) -> Parameters {
        use Method as M;
        let simplifying = InitialSize::Gamma(4.0);
        let (generator, initial_size) = match self {
            M::Ed | M::Med | M::MedPlus | M::Ced => {
                (Generator::ErrorDiffusion, InitialSize::Target)
            }
            M::Preview => (Generator::Insertion, InitialSize::Target),
            M::Gprfsed | M::Mgprfs | M::Optimal | M::Flat | M::Cgprfsed => {
                (Generator::ErrorDiffusion, simplifying)
            }
            M::Gpr | M::Mgpr | M::Cgpr => (Generator::All, InitialSize::Percent(100.0)),
        };
        let (policy, startup) = match self {
            M::Med | M::MedPlus | M::Mgprfs | M::Optimal | M::Flat | M::Mgpr | M::Preview => {
                (Policy::PsdMaxD, Startup::Mirroring)
            }
            M::Ed | M::Gprfsed | M::Gpr => (Policy::PsaD, Startup::Classic),
            M::Ced | M::Cgprfsed | M::Cgpr => (Policy::PsbD, Startup::Classic),
        };
        let guide = match self {
            M::Ced | M::Cgprfsed => Guide::Luma,
            M::Cgpr => Guide::Gray,
            _ => Guide::Components,
        };
        let effort = match self {
            M::Optimal => DEFAULT_EFFORT,
            M::Flat => FLAT_EFFORT,
            _ => 0,
        };
        let reconstruction = match self {
            M::Flat => Reconstruction::Flat,
            _ => Reconstruction::Linear,
        };
        // Refinement makes good what the exact order would be worth.
        let parallel = if self == M::Optimal { Parallel::Tiles } else { Parallel::Exact };
        let bad_point_removal = self == M::MedPlus;
        Parameters {
            initial_size,
            generator,
            policy,
            startup,
            guide,
            bad_point_removal,
            effort,
            reconstruction,
            parallel,
            ..Parameters::default().target(target)
        }
    }

    /// The number of components this method is made for; `None` for any.
    #[must_use]
    pub fn component_count(self) -> Option<usize> {
        match self {
            Self::Med
            | Self::MedPlus
            | Self::Mgprfs
            | Self::Optimal
            | Self::Flat
            | Self::Mgpr
            | Self::Preview => None,
            Self::Ed | Self::Gprfsed | Self::Gpr => Some(1),
            Self::Ced | Self::Cgprfsed | Self::Cgpr => Some(3),
        }
    }

    /// Checks that the method is defined for images of `actual` components.
    ///
    /// # Errors
    /// [`ParameterError::ComponentCount`], which names the methods that are.
    pub fn check_component_count(self, actual: usize) -> Result<(), ParameterError> {
        check_count(Self::PARAMETER, self, Self::ALL, Self::name, Self::component_count, actual)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_method_is_the_set_of_choices_that_its_description_says() {
        use Generator::{All, ErrorDiffusion, Insertion};
        use Method as M;
        let four_times = InitialSize::Gamma(4.0);
        for &method in Method::ALL {
            let made = method.parameters(Target::Size(77));
            let points = match method {
                M::Ed | M::Med | M::MedPlus | M::Ced => (ErrorDiffusion, InitialSize::Target),
                M::Gpr | M::Mgpr | M::Cgpr => (All, InitialSize::Percent(100.0)),
                M::Preview => (Insertion, InitialSize::Target),
                _ => (ErrorDiffusion, four_times),
            };
            assert_eq!((made.generator, made.initial_size), points, "{method}");
            assert_eq!(made.target, Target::Size(77));
            let guide = match method {
                M::Ced | M::Cgprfsed => Guide::Luma,
                M::Cgpr => Guide::Gray,
                _ => Guide::Components,
            };
            assert_eq!(made.guide, guide, "{method}");
            let (policy, startup) = match method.component_count() {
                Some(1) => (Policy::PsaD, Startup::Classic),
                Some(_) => (Policy::PsbD, Startup::Classic),
                None => (Policy::PsdMaxD, Startup::Mirroring),
            };
            assert_eq!((made.policy, made.startup), (policy, startup), "{method}");
            assert_eq!(method.component_count() == Some(3), guide != Guide::Components, "{method}");
            assert_eq!(made.bad_point_removal, method == M::MedPlus);
            assert_eq!(made.reconstruction == Reconstruction::Flat, method == M::Flat);
            let effort = match method {
                M::Optimal => DEFAULT_EFFORT,
                M::Flat => FLAT_EFFORT,
                _ => 0,
            };
            assert_eq!(made.effort, effort, "{method}");
            assert_eq!(made.parallel == Parallel::Tiles, method == M::Optimal, "{method}");
        }
    }
}
