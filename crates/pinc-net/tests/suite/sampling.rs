//! Samples of the domain.

use pinc_net::{Domain, Sampler};

fn domain() -> Domain {
    Domain::new([-3.0..=3.0, 2.0..=20.0], [-1.0..=1.0])
}

#[test]
fn points_lie_in_the_box_and_differ_by_seed() {
    for sampler in [Sampler::Independent, Sampler::CoupledGrid, Sampler::Sobol] {
        let points = sampler.collocation(1000, 0.5, &domain(), 10, 7);
        assert_eq!(points.len(), 1000);
        for i in 0..points.len() {
            assert!((0.0..=0.5).contains(&points.time(i)));
            assert!((-3.0..=3.0).contains(&points.state(i)[0]));
            assert!((2.0..=20.0).contains(&points.state(i)[1]));
            assert!((-1.0..=1.0).contains(&points.input(i)[0]));
        }
        assert_eq!(points, sampler.collocation(1000, 0.5, &domain(), 10, 7));
        assert_ne!(points, sampler.collocation(1000, 0.5, &domain(), 10, 8));
    }
}

#[test]
fn sobol_points_fill_every_eighth_of_every_coordinate_evenly() {
    let points = Sampler::Sobol.collocation(1024, 1.0, &domain(), 1, 3);
    let mut counts = [0; 8];
    for i in 0..points.len() {
        let unit = (points.state(i)[1] - 2.0) / 18.0;
        let eighth = (0..8).rfind(|&k| unit >= f64::from(k) / 8.0).unwrap_or(0);
        counts[usize::try_from(eighth).unwrap()] += 1;
    }
    // 2^10 points of a (0, 10, 1)-net have exactly 2^7 in each interval of length 2^-3.
    assert_eq!(counts, [128; 8]);
}

#[test]
fn coupled_grid_has_both_ends_of_the_step_for_every_scenario() {
    let points = Sampler::CoupledGrid.collocation(40, 0.5, &domain(), 4, 1);
    for scenario in 0..4 {
        assert!(points.time(scenario * 10).abs() < f64::EPSILON);
        assert!((points.time(scenario * 10 + 9) - 0.5).abs() < f64::EPSILON);
        assert_eq!(points.state(scenario * 10), points.state(scenario * 10 + 9));
    }
    assert_ne!(points.state(0), points.state(10));
}

/// The generator has 2^16 points of a scramble: later ones are others.
#[test]
fn the_sequence_continues_beyond_its_period() {
    let points = Sampler::Sobol.collocation((1 << 16) + 1, 1.0, &domain(), 1, 3);
    assert!(points.time(0) - points.time(1 << 16) != 0.0);
}
