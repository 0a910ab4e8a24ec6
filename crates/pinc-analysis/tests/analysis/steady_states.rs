//! Steady states that are known.

use super::{chemostat, plant, region};
use pinc_analysis::{HeldPoint, OperatingPoint, SteadyStateSearch};

#[track_caller]
fn within(found: &HeldPoint) -> &OperatingPoint {
    match found {
        HeldPoint::Within(point) => point,
        other => panic!("{other:?}"),
    }
}

#[test]
fn rounded_references_are_held() {
    // A magnet: gap = 0.015 m asks for i = gap sqrt(g m / C) = 1.51427 A or so, given as 1.516.
    let (g, m, c) = (9.81_f64, 0.068_f64, 6.53e-5_f64);
    let plant = plant(
        &["gap", "v", "i"],
        &["u"],
        &["v", "9.81 - 6.53e-5/0.068*(i/gap)^2", "(u - 10*i)/0.41"],
    );
    let region = region(3, &[0.007, -0.3, 0.2, 0.0], &[0.02, 0.3, 3.0, 30.0]);
    let search = SteadyStateSearch::new(&plant, &region, 1);
    let bounds = Some((&region.low[..], &region.high[..]));
    let current = 0.015 * (g * m / c).sqrt();
    let rounded = (current * 1000.0).round() / 1000.0;
    let found = search.hold(&[(0, 0.015), (1, 0.0), (2, rounded)], bounds);
    let point = within(&found);
    assert!((point.x[2] / point.x[0] - current / 0.015).abs() < 1e-6, "{point:?}");
    assert!((point.u[0] - 10.0 * point.x[2]).abs() < 1e-6);
    // Off by a tenth it is none, and the one that is named is near.
    let HeldPoint::Nowhere(Some(near)) = search.hold(&[(0, 0.015), (1, 0.0), (2, 1.8)], bounds)
    else {
        panic!("held")
    };
    assert!((near.x[2] / near.x[0] - current / 0.015).abs() < 1e-4, "{near:?}");
}

/// At rest both states equal the input: how wide their bounds are does not matter.
#[test]
fn what_no_input_holds_is_not_held_with_wide_bounds() {
    let plant = plant(&["x", "y"], &["u"], &["u - x", "u - y"]);
    for wide in [10.0, 1e3, 1e5] {
        let region = region(2, &[-wide, -wide, -5.0], &[wide, wide, 5.0]);
        let search = SteadyStateSearch::new(&plant, &region, 1);
        let bounds = Some((&region.low[..], &region.high[..]));
        let found = search.hold(&[(0, 1.0), (1, 2.0)], bounds);
        assert!(matches!(found, HeldPoint::Nowhere(Some(_))), "{wide}: {found:?}");
        assert!((within(&search.hold(&[(0, 1.0), (1, 1.0)], bounds)).u[0] - 1.0).abs() < 1e-4);
    }
}

#[test]
fn stiff_rates_at_rest_are_rest() {
    for seconds in [1.0, 3600.0, 1e-6] {
        let mu = "0.4*S/(0.1 + S)";
        let rates =
            [format!("({mu} - D)*X/{seconds}"), format!("(D*(10 - S) - 2*{mu}*X)/{seconds}")];
        let plant = plant(&["X", "S"], &["D"], &[&rates[0], &rates[1]]);
        let region = region(2, &[2.0, 0.0, 0.0], &[6.0, 3.0, 0.38]);
        let near = OperatingPoint { x: vec![4.9, 0.2], u: vec![0.19] };
        let search = SteadyStateSearch::new(&plant, &region, 1).near(near);
        // S = 0.1: D = mu = 0.2, X = (10 - S)/2.
        let found = search.hold(&[(1, 0.1)], Some((&region.low, &region.high)));
        let point = within(&found);
        assert!((point.u[0] - 0.2).abs() < 1e-6 && (point.x[0] - 4.95).abs() < 1e-6, "{point:?}");
    }
}

#[test]
fn the_steady_state_in_the_region_is_taken() {
    // With D = 0.2 also X = 0, S = 10, the washout, is at rest.
    let plant = chemostat("0.4*S/(0.1 + S)").compile().unwrap();
    let region = region(2, &[2.0, 0.0, 0.0], &[6.0, 3.0, 0.38]);
    for seed in 1..20 {
        let start = region.points(seed).next().unwrap();
        let search = SteadyStateSearch::new(&plant, &region, seed).near(start);
        let point = search.settle(&[0.2]).unwrap();
        assert!((point.x[0] - 4.95).abs() < 1e-6 && (point.x[1] - 0.1).abs() < 1e-6, "{point:?}");
    }
}

#[test]
fn a_plant_that_is_never_at_rest_has_no_steady_state() {
    let plant = plant(&["x", "y"], &["u"], &["u - x", "1 + x^2"]);
    let region = region(2, &[-2.0, -2.0, -1.0], &[2.0, 2.0, 1.0]);
    assert_eq!(SteadyStateSearch::new(&plant, &region, 1).settle(&[0.0]), None);
}

#[test]
fn bounds_are_kept_and_what_would_be_needed_is_found() {
    let plant = plant(&["x"], &["u"], &["u - x"]);
    let region = region(1, &[-2.0, -1.0], &[2.0, 1.0]);
    let search = SteadyStateSearch::new(&plant, &region, 1);
    let bounds = Some((&region.low[..], &region.high[..]));
    let HeldPoint::Outside(point) = search.hold(&[(0, 1.5)], bounds) else { panic!("held") };
    assert!((point.u[0] - 1.5).abs() < 1e-9);
}

/// Where a state has no bounds, its width says nothing of how far it moves.
#[test]
fn a_state_of_another_size_than_its_width_is_found() {
    for size in [1.0, 1e3, 1e6] {
        let (fill, leave) = (format!("{size}*u - 0.1*p"), format!("p*{} - e", 0.01 / size));
        let plant = plant(&["p", "e"], &["u"], &[&fill, &leave]);
        let region = region(2, &[-0.5, 0.0, 0.0], &[0.5, 0.1, 1.0]);
        let found = SteadyStateSearch::new(&plant, &region, 1).hold(&[(1, 0.05)], None);
        let point = within(&found);
        assert!((point.u[0] - 0.5).abs() < 1e-6, "{size}: {point:?}");
    }
}
