//! Methods and policies that mean the same for one component.

use crate::pictures::{cases, model, pictures, size_target};
use pixmesh_meshing::Method;
use pixmesh_meshing::parameters::{Policy, Startup};
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(100))]

    #[test]
    fn gray_policies_of_one_significance_agree(
        image in pictures(2..=14, 1..=1),
        share in 0.0..0.5,
        startup in prop::sample::select(Startup::ALL),
    ) {
        let of_mmsodd = [Policy::PsaD, Policy::PsdMaxD, Policy::PsdAvgD, Policy::PseD];
        let of_mol = [Policy::PsaL, Policy::PsdMaxL, Policy::PsdAvgL, Policy::PseL];
        for policies in [of_mmsodd, of_mol] {
            for method in [Method::Med, Method::Mgprfs] {
                let own = method.parameters(size_target(&image, share));
                let of = |policy| model(&image, &own.clone().policy(policy).startup(startup));
                let first = of(policies[0]);
                for policy in &policies[1..] {
                    prop_assert_eq!(&of(*policy), &first, "{}", policy);
                }
            }
        }
    }

    #[test]
    fn modified_methods_equal_gray_methods_on_gray(
        image in pictures(2..=14, 1..=1),
        share in 0.0..0.5,
    ) {
        use Method::{Ed, Gpr, Gprfsed, Med, Mgpr, Mgprfs};
        for (modified, gray) in [(Med, Ed), (Mgprfs, Gprfsed), (Mgpr, Gpr)] {
            let target = size_target(&image, share);
            let classic = modified.parameters(target).startup(Startup::Classic);
            let expected = model(&image, &gray.parameters(target));
            prop_assert_eq!(model(&image, &classic), expected, "{} and {}", modified, gray);
        }
    }
}
