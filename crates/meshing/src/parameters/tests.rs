//! Plans of parameters, and the values that are refused.

use super::*;
use crate::parameters::method::Method;

fn shape(width: usize, height: usize, component_count: usize) -> Shape {
    Shape { width, height, component_count, precision: 8 }
}

fn plan(method: Method, target: Target, shape: Shape) -> Result<Plan, ParameterError> {
    method.parameters(target).plan(shape)
}

#[test]
fn sizes_are_floors_of_percentages() {
    let lena = shape(512, 512, 3);
    let of = |method, density| plan(method, Target::Percent(density), lena).unwrap();
    assert_eq!(of(Method::Med, 2.0), Plan { size: 5242, initial_size: 5242 });
    assert_eq!(of(Method::Mgprfs, 2.0).initial_size, 20971);
    assert_eq!(of(Method::Mgprfs, 0.5).size, 1310);
    assert_eq!(of(Method::Mgprfs, 0.5).initial_size, 5242);
    assert_eq!(of(Method::Mgprfs, 60.0).initial_size, 262_144);
}

#[test]
fn stages_follow_from_the_choices() {
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
    let even = Plan { size: 9, initial_size: 9 };
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
fn smoothing_order_is_odd_and_in_range() {
    let own = Method::Med.parameters(Target::Size(50));
    for smoothing_order in 0..=MAX_SMOOTHING_ORDER + 2 {
        let parameters = Parameters { smoothing_order, ..own.clone() };
        let is_good = smoothing_order % 2 == 1 && smoothing_order <= MAX_SMOOTHING_ORDER;
        assert_eq!(parameters.check().is_ok(), is_good, "{smoothing_order}");
    }
}

#[test]
fn percentages_round_down_to_at_least_the_corners() {
    for (percent, side, expected) in [
        (0.7, 1000, 7000),
        (4.1, 1000, 41000),
        (0.29, 1000, 2900),
        (100.0, 3, 9),
        (2.0, 2, 4),
        (0.1, 5, 4),
        (MIN_PERCENT, 100, 4),
    ] {
        let plan = plan(Method::Med, Target::Percent(percent), shape(side, side, 1)).unwrap();
        assert_eq!(plan.size, expected, "{percent} % of {side}x{side}");
    }
    let plan = plan(Method::Mgprfs, Target::Size(10), shape(8, 8, 1)).unwrap();
    assert_eq!((plan.size, plan.initial_size), (10, 40));
}

#[test]
fn refuses_fewer_initial_points_than_vertices() {
    let plan = |initial_size| {
        let own = Parameters::default().target(Target::Percent(50.0)).initial_size(initial_size);
        own.plan(shape(20, 10, 1)).map_err(|error| error.to_string())
    };
    for initial_size in [InitialSize::Size(100), InitialSize::Percent(50.0)] {
        assert_eq!(plan(initial_size).unwrap().initial_size, 100);
    }
    let refused = "initial_size is 99, but must lie in 100 to 200";
    assert_eq!(plan(InitialSize::Size(99)).unwrap_err(), refused);
    let refused = "initial_density is 20, but must lie in 50 to 100";
    assert_eq!(plan(InitialSize::Percent(20.0)).unwrap_err(), refused);
}

#[test]
fn refuses_numbers_out_of_range() {
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
fn names_the_methods_for_a_component_count() {
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
fn names_parse_as_their_values() {
    for &method in Method::ALL {
        assert_eq!(method.name().parse(), Ok(method));
    }
    let error = "MED".parse::<Method>().unwrap_err();
    assert!(error.to_string().contains("cannot be 'MED': allowed are ed, med"), "{error}");
}

#[test]
fn psnr_needs_a_metric_of_squared_errors() {
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
fn refuses_other_component_counts() {
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
