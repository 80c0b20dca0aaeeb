//! The methods: named sets of [`Parameters`], those of the thesis and four more.
//!
//! "Effective Techniques for Generating Delaunay Mesh Models of Single- and Multi-Component
//! Images" (thesis, University of Victoria) describes one framework: a policy turns the image
//! into a density, error diffusion picks initial points of that density, and greedy point removal
//! simplifies their triangulation.

use crate::parameters::choices::{
    Generator, Guide, Parallel, Policy, Reconstruction, Startup, for_component_counts, named_values,
};
use crate::parameters::{InitialSize, ParameterError, Parameters, Target};

named_values! {
    /// The named methods.
    ///
    /// ```
    /// use pixmesh_meshing::{Method, Parameters, Target};
    /// let method: Method = "mgprfs".parse()?;
    /// assert_eq!(method.parameters(Target::Percent(2.0)), Parameters::default());
    /// # Ok::<(), pixmesh_meshing::ParameterError>(())
    /// ```
    "method" Method {
        /// Error diffusion of one component with classic start-up; no simplification.
        Ed = "ed",
        /// Modified error diffusion of any number of components; no simplification: fast.
        Med = "med",
        /// MED without the points whose removal lowers the error: better, with fewer points.
        MedPlus = "med+",
        /// Error diffusion of one component to 4 times the points, then greedy point removal.
        Gprfsed = "gprfsed",
        /// Modified error diffusion of any number of components to 4 times the points, then greedy
        /// point removal: good.
        Mgprfs = "mgprfs",
        /// MGPRFS, then refinement by the effort, which moves and exchanges vertices: best.
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
        /// Points inserted one by one where the error is largest, above a megapixel diffused in a
        /// reduced picture, any number of components; no simplification: fastest.
        Preview = "preview",
    }
}

for_component_counts!(Method: Ed | Gprfsed | Gpr => 1, Ced | Cgprfsed | Cgpr => 3);

impl Method {
    /// The parameters that define this method, for a target.
    #[must_use]
    pub fn parameters(self, target: Target) -> Parameters {
        let mgprfs = Parameters::default().target(target);
        let all_points = InitialSize::Percent(100.0);
        let own = match self.component_count() {
            Some(1) => mgprfs.policy(Policy::PsaD).startup(Startup::Classic),
            Some(_) => mgprfs.policy(Policy::PsbD).startup(Startup::Classic).guide(Guide::Luma),
            None => mgprfs,
        };
        match self {
            Self::Mgprfs | Self::Gprfsed | Self::Cgprfsed => own,
            Self::Ed | Self::Med | Self::Ced => own.initial_size(InitialSize::Target),
            Self::MedPlus => own.initial_size(InitialSize::Target).bad_point_removal(true),
            Self::Gpr | Self::Mgpr => own.generator(Generator::All).initial_size(all_points),
            Self::Cgpr => own.generator(Generator::All).initial_size(all_points).guide(Guide::Gray),
            Self::Preview => own.generator(Generator::Insertion).initial_size(InitialSize::Target),
            // Refinement gains more than the exact order of removal.
            Self::Optimal => own.effort(5).parallel(Parallel::Tiles),
            Self::Flat => own.effort(6).reconstruction(Reconstruction::Flat),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_the_choices_of_their_descriptions() {
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
                M::Optimal => 5,
                M::Flat => 6,
                _ => 0,
            };
            assert_eq!(made.effort, effort, "{method}");
            assert_eq!(made.parallel == Parallel::Tiles, method == M::Optimal, "{method}");
        }
    }
}
