//! What parameters mean, and which are refused.

use super::*;
use crate::parameters::method::Method;

fn shape(width: usize, height: usize, component_count: usize) -> Shape {
    Shape { width, height, component_count, precision: 8 }
}

fn plan(method: Method, target: Target, shape: Shape) -> Result<Plan, ParameterError> {
    method.parameters(target).plan(shape)
}

#[test]
fn sizes_are_the_floor_of_the_density_and_not_gamma_times_the_size() {
    let lena = shape(512, 512, 3);
    let of = |method, density| plan(method, Target::Percent(density), lena).unwrap();
    assert_eq!(of(Method::Med, 2.0), Plan { size: 5242, initial_size: 5242, bound: None });
    assert_eq!(of(Method::Mgprfs, 2.0).initial_size, 20971);
    assert_eq!(of(Method::Mgprfs, 0.5).size, 1310);
    assert_eq!(of(Method::Mgprfs, 0.5).initial_size, 5242);
    assert_eq!(of(Method::Mgprfs, 60.0).initial_size, 262_144);
}

#[test]
fn what_is_done_follows_from_each_choice_alone() {
    let size = |size| Parameters::default().initial_size(InitialSize::Target).target(size);
    let plain = size(Target::Size(9));
    let effort = plain.clone().effort(1);
    let free = plain.clone().connectivity(Connectivity::Free);
    let fitted = plain.clone().values(Values::Fitted);
    let flat = plain.clone().reconstruction(Reconstruction::Flat);
    let bad = plain.clone().bad_point_removal(true);
    let all = [&plain, &effort, &free, &fitted, &flat, &bad];
    assert_eq!(all.map(Parameters::refines), [false, true, true, true, false, false]);
    assert_eq!(all.map(Parameters::is_of_points_alone), [true, true, false, false, false, true]);
    assert_eq!(all.map(Parameters::is_flat), [false, false, false, false, true, false]);
    let even = Plan { size: 9, initial_size: 9, bound: None };
    assert_eq!(all.map(|p| p.simplifies(&even)), [false, true, false, false, false, true]);
    assert!(plain.simplifies(&Plan { initial_size: 10, ..even }));
    assert!(!plain.searches() && !effort.searches() && !flat.searches());
    let psnr = Target::Psnr(30.0);
    assert!(size(psnr).searches());
    let searches = all.map(|parameters| {
        parameters.clone().initial_size(InitialSize::Gamma(4.0)).target(psnr).searches()
    });
    assert_eq!(searches, [false, true, true, true, true, false]);
}

#[test]
fn a_smoothing_order_is_odd_and_within_its_bounds() {
    let own = Method::Med.parameters(Target::Size(50));
    for smoothing_order in 0..=MAX_SMOOTHING_ORDER + 2 {
        let parameters = Parameters { smoothing_order, ..own.clone() };
        let is_good = smoothing_order % 2 == 1 && smoothing_order <= MAX_SMOOTHING_ORDER;
        assert_eq!(parameters.check().is_ok(), is_good, "{smoothing_order}");
    }
}

#[test]
fn binary_fractions_do_not_lose_a_point() {
    for (density, side, expected) in
        [(0.7, 1000, 7000), (4.1, 1000, 41000), (0.29, 1000, 2900), (100.0, 3, 9)]
    {
        let plan = plan(Method::Med, Target::Percent(density), shape(side, side, 1)).unwrap();
        assert_eq!(plan.size, expected, "{density} % of {side}x{side}");
    }
}

#[test]
fn a_density_of_less_than_the_corners_means_the_corners() {
    for (side, density) in [(2, 2.0), (2, 100.0), (5, 0.1), (100, MIN_PERCENT)] {
        let plan = plan(Method::Mgprfs, Target::Percent(density), shape(side, side, 3)).unwrap();
        assert_eq!(plan.size, 4);
    }
}

#[test]
fn a_mesh_cannot_end_with_more_points_than_it_starts_with() {
    let plan = |initial_size| {
        let target = Target::Percent(50.0);
        Parameters { initial_size, ..Parameters::default().target(target) }.plan(shape(10, 10, 1))
    };
    assert_eq!(plan(InitialSize::Size(50)).unwrap().initial_size, 50);
    assert_eq!(plan(InitialSize::Percent(50.0)).unwrap().initial_size, 50);
    let message = plan(InitialSize::Size(49)).unwrap_err().to_string();
    assert_eq!(message, "initial_size is 49, but must lie in 50 to 100");
    let message = plan(InitialSize::Percent(20.0)).unwrap_err().to_string();
    assert_eq!(message, "initial_density is 20, but must lie in 50 to 100");
}

#[test]
fn sizes_given_as_sizes_are_literal() {
    let plan = plan(Method::Mgprfs, Target::Size(10), shape(8, 8, 1)).unwrap();
    assert_eq!((plan.size, plan.initial_size), (10, 40));
}

#[test]
fn numbers_out_of_bounds_are_refused_by_name() {
    let refused = |target| plan(Method::Mgprfs, target, shape(64, 64, 3)).unwrap_err().to_string();
    for density in [0.0, -0.0, -1.0, 101.0, 100.000_000_1, 1e308] {
        let message = refused(Target::Percent(density));
        assert!(message.starts_with("density is ") && message.ends_with("to 100"), "{message}");
    }
    assert!(refused(Target::Percent(f64::NAN)).contains("density must be a finite"));
    assert!(refused(Target::Percent(f64::INFINITY)).contains("density must be a finite"));
    assert!(refused(Target::Percent(1e-300)).contains("must lie in 0.000001 to 100"));
    assert!(refused(Target::Size(3)).contains("size is 3"));
    assert!(refused(Target::Size(4097)).contains("4 to 4096"));
}

#[test]
fn a_method_names_the_alternatives_for_the_wrong_number_of_components() {
    let error = plan(Method::Ed, Target::Percent(2.0), shape(64, 64, 3)).unwrap_err();
    assert!(error.to_string().contains("policy 'psa_d'"), "{error}");
    assert!(error.to_string().contains("psd_max_d"), "{error}");
    let error = Method::Ced.check_component_count(1).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("ed, med, med+, gprfsed, mgprfs, optimal, flat, gpr, mgpr, preview"),
        "{error}"
    );
    assert_eq!(Method::Mgpr.check_component_count(7), Ok(()));
}

#[test]
fn names_read_back_as_the_values_they_name() {
    for &method in Method::ALL {
        assert_eq!(method.name().parse(), Ok(method));
    }
    let error = "MED".parse::<Method>().unwrap_err();
    assert!(error.to_string().contains("cannot be 'MED': allowed are ed, med"), "{error}");
}

#[test]
fn an_initial_density_that_is_too_small_is_told_in_percent() {
    let target = Target::Percent(50.0);
    let initial_size = InitialSize::Percent(20.0);
    let parameters = Parameters { initial_size, ..Parameters::default().target(target) };
    let message = parameters.plan(shape(20, 10, 1)).unwrap_err().to_string();
    assert_eq!(message, "initial_density is 20, but must lie in 50 to 100");
    let parameters = Parameters { initial_size: InitialSize::Size(40), ..parameters };
    let message = parameters.plan(shape(20, 10, 1)).unwrap_err().to_string();
    assert_eq!(message, "initial_size is 40, but must lie in 100 to 200");
}

#[test]
fn a_psnr_needs_a_metric_of_squared_errors() {
    for &error_metric in ErrorMetric::ALL {
        let of = |method: Method| {
            let own = method.parameters(Target::Psnr(30.0));
            Parameters { error_metric, ..own }.plan(shape(16, 16, 3)).map(|_| ())
        };
        let refused = Err(ParameterError::TargetNeedsSquaredError(error_metric));
        let is_squared = matches!(error_metric, ErrorMetric::MeanCompSe | ErrorMetric::VecSe);
        assert_eq!(of(Method::Mgpr), if is_squared { Ok(()) } else { refused.clone() });
        // The luma has one component, and a metric of three is that of one there.
        let is_squared_of_one = is_squared || error_metric.name().ends_with("_se");
        assert_eq!(of(Method::Cgpr), if is_squared_of_one { Ok(()) } else { refused });
    }
}

#[test]
fn what_is_made_for_a_number_of_components_is_refused_for_others_alone() {
    for (method, count) in [(Method::Ed, 1), (Method::Gpr, 1), (Method::Ced, 3), (Method::Cgpr, 3)]
    {
        let own = method.parameters(Target::Size(9));
        assert!(own.plan(shape(16, 16, count)).is_ok(), "{method}");
        // Points that no density chooses need no policy.
        let is_free = method == Method::Gpr;
        assert_eq!(own.plan(shape(16, 16, 2)).is_ok(), is_free, "{method}");
    }
    for &error_metric in ErrorMetric::ALL {
        let own = Method::Mgpr.parameters(Target::Size(9));
        let parameters = Parameters { error_metric, ..own };
        for count in 1..5 {
            let fits = error_metric.component_count().is_none_or(|needed| needed == count);
            assert_eq!(parameters.plan(shape(16, 16, count)).is_ok(), fits, "{error_metric}");
        }
    }
}
