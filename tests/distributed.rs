//! The plants of `configs/distributed` against balances and steady states that are computed in
//! another way.

use pinc_config::{Experiment, Plants};
use pinc_ode::{AccurateIntegrator, DynPlant};
use std::path::Path;

fn plant(config: &str, sets: &[&str]) -> Box<dyn DynPlant> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/distributed").join(config);
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    Experiment::load(&path, &sets, &Plants::built_in()).unwrap().plant.dyn_plant()
}

fn rates(plant: &dyn DynPlant, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut dx = vec![0.0; x.len()];
    plant.rhs(x, u, &[], &mut dx);
    dx
}

/// Where the plant comes to rest.
fn rest(plant: &dyn DynPlant, mut x: Vec<f64>, u: &[f64], time_s: f64) -> Vec<f64> {
    let mut truth = AccurateIntegrator::shared(plant.to_shared(), 1e-8);
    truth.integrate(&mut x, u, time_s).unwrap();
    x
}

/// The rod in numbers: its cross section, and what its surface loses per length.
const AREA: f64 = std::f64::consts::PI * 0.01 * 0.01;
const CONDUCTION: f64 = 50.0 * AREA;
const CLAMP: f64 = 200.0 * AREA;

fn loss(t: f64) -> f64 {
    let kelvin = |t: f64| (t + 273.15).powi(4);
    let radiation = 0.8 * 5.670_374_419e-8 * (kelvin(t) - kelvin(20.0));
    std::f64::consts::PI * 0.02 * (10.0 * (t - 20.0) + radiation)
}

#[test]
fn the_heat_of_the_rod_is_what_goes_in_less_what_goes_out() {
    for n in [20_u32, 50, 100] {
        let rod = plant("rod.toml", &[&format!("plant.expression.sizes.n={n}")]);
        let dz = 0.2 / f64::from(n);
        let x: Vec<f64> = (0..n).map(|i| 90.0 + 60.0 * f64::from(i * i % 17).sin()).collect();
        let stored: f64 =
            rates(&*rod, &x, &[37.0]).iter().map(|rate| rate * 7800.0 * 480.0 * AREA * dz).sum();
        let lost: f64 = x.iter().map(|t| loss(*t) * dz).sum();
        let expected = 37.0 - lost - CLAMP * (x[x.len() - 1] - 20.0);
        assert!((stored - expected).abs() < 1e-9 * 37.0, "{n}: {stored} {expected}");
    }
}

/// The temperature at the cold end and the heat that arrives there, by RK4 along the rod from a
/// temperature at the heated end.
fn along_the_rod(hot_end: f64, power: f64) -> (f64, f64) {
    let (steps, mut y) = (2000, [hot_end, power]);
    let h = 0.2 / f64::from(steps);
    let slope = |y: [f64; 2]| [-y[1] / CONDUCTION, -loss(y[0])];
    let moved = |y: [f64; 2], k: [f64; 2], by: f64| [y[0] + by * k[0], y[1] + by * k[1]];
    for _ in 0..steps {
        let a = slope(y);
        let b = slope(moved(y, a, h / 2.0));
        let c = slope(moved(y, b, h / 2.0));
        let d = slope(moved(y, c, h));
        y = [0, 1].map(|i| y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
    }
    (y[0], y[1])
}

/// By shooting: the temperature of the heated end at which the clamp takes what arrives.
fn hot_end(power: f64) -> f64 {
    let (mut low, mut high) = (20.0, 400.0);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        let (cold_end, heat) = along_the_rod(middle, power);
        if heat < CLAMP * (cold_end - 20.0) { high = middle } else { low = middle }
    }
    low
}

#[test]
fn the_rod_at_rest_matches_the_differential_equation() {
    let power = 15.0;
    let (hot, (cold, _)) = (hot_end(power), along_the_rod(hot_end(power), power));
    let ends = [20_u32, 40].map(|n| {
        let rod = plant("rod.toml", &[&format!("plant.expression.sizes.n={n}")]);
        let x = rest(&*rod, vec![100.0; n as usize], &[power], 20_000.0);
        // The ends are half a part away from the middles of the first and the last part.
        let half = 0.1 / f64::from(n) * power / CONDUCTION;
        let cold_half = 0.1 / f64::from(n) * CLAMP * (cold - 20.0) / CONDUCTION;
        [x[0] + half, x[x.len() - 1] - cold_half]
    });
    // The clamp acts in the middle of the last part: of order 1 in the length of a part, so that
    // twice the finer answer less the coarser one is of order 2, some (1/20)^2 of what the ends
    // are above the air, 119 and 32 degrees.
    for (i, (exact, tolerance)) in [(hot, 0.1), (cold, 0.04)].into_iter().enumerate() {
        let [coarse, fine] = [ends[0][i], ends[1][i]];
        let error = 2.0 * fine - coarse - exact;
        assert!(error.abs() < tolerance, "{ends:?}: off by {error}, {exact}");
    }
}

/// The hottest place and the conversion of the reactor at rest, by steps along the tube with the
/// numbers as they were published, per hour and with calories.
fn along_the_tube(bath: f64, feed: f64) -> (f64, f64) {
    let (mut p, mut t, mut hottest) = (feed, 625.0_f64, 625.0_f64);
    let steps = 100_000;
    let dz = 3.0 / f64::from(steps);
    for _ in 0..steps {
        let rate = 1300.0 * (19.837 - 13636.0 / t).exp() * 0.208 * p;
        let cooled = 4.0 * 82.7 / 0.0254 * (t - bath);
        t += dz * (307_000.0 * rate - cooled) / (4684.0 * 0.237);
        p = (p - dz * 29.48 / 4684.0 * rate).max(0.0);
        hottest = hottest.max(t);
    }
    (hottest, 1.0 - p / feed)
}

#[test]
fn the_reactor_at_rest_matches_the_differential_equation() {
    let (hottest, conversion) = along_the_tube(625.0, 0.015);
    let found = [40_u32, 160].map(|n| {
        let reactor = plant("reactor.toml", &[&format!("plant.expression.sizes.n={n}")]);
        let x = rest(&*reactor, vec![625.0; n as usize], &[625.0], 20_000.0);
        let mut y = [0.0];
        reactor.output(&x, &[625.0], &[], &mut y);
        (x.into_iter().fold(0.0, f64::max), y[0])
    });
    // A method of order 1 in the length of a part, which is a quarter: four times the finer answer
    // less the coarser one, over 3, is of order 2.
    let [(coarse, coarse_share), (fine, fine_share)] = found;
    let error = (4.0 * fine - coarse) / 3.0 - hottest;
    assert!(error.abs() < 0.15, "{found:?}: off by {error}, {hottest}");
    let error = (4.0 * fine_share - coarse_share) / 3.0 - conversion;
    assert!(error.abs() < 5e-4, "{found:?}: off by {error}, {conversion}");
}

/// As published, the reactor runs away when the feed has some per mille of o-xylene more.
#[test]
fn the_reactor_runs_away_with_a_richer_feed() {
    let hottest = |feed: f64| {
        let feed = format!("plant.expression.parameters.feed={feed}");
        let reactor = plant("reactor.toml", &["plant.expression.sizes.n=100", &feed]);
        let x = rest(&*reactor, vec![625.0; 100], &[625.0], 20_000.0);
        x.into_iter().fold(0.0, f64::max)
    };
    let (safe, lost) = (hottest(0.0165), hottest(0.0195));
    assert!(safe < 680.0 && lost > 900.0, "{safe} {lost}");
}
