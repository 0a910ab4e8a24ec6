//! The gas-lifted well: its algebraic pressures against the equations with them eliminated by hand,
//! casing heading without control, and the pressure held where the well is unstable. The well with
//! a pump: a published program's steady state, and the pressure at the intake held.

use crate::common::{outcome, pinc, repository};
use pinc_ad::Scalar;
use pinc_config::{Experiment, Plants};
use pinc_ode::{AccurateIntegrator, Dopri5, DynPlant, Plant, Variable};

fn well() -> Box<dyn DynPlant> {
    plant("gas-lift.toml")
}

fn plant(config: &str) -> Box<dyn DynPlant> {
    let path = repository("configs/oil-well").join(config);
    Experiment::load(&path, &[], &Plants::built_in()).unwrap().plant.dyn_plant()
}

/// The model of Eikrem, Aamo and Foss as an ordinary differential equation, in SI units.
#[derive(Clone, Debug)]
struct Eliminated;

impl Plant for Eliminated {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 3] =
            [Variable::new("x1", "kg"), Variable::new("x2", "kg"), Variable::new("x3", "kg")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("u", ""), Variable::new("w_gc", "kg/s")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let zero = x[0].constant(0.0);
        let (annulus, tubing) = (8.314 * 348.0 / 0.0167, 8.314 * 369.4 / 0.0167);
        let (volume, below) = (2048.0 * 0.01410, 75.0 * 0.0314);
        let p_ai = x[0] * ((annulus + 9.81 * 2048.0) / 64.34);
        let p_wh = x[1] * tubing / (-x[2] / 760.0 + (volume + below));
        let rho_m = (x[1] + x[2] - 760.0 * below) / volume;
        let p_wi = p_wh + rho_m * (9.81 * 2048.0);
        let p_wb = p_wi + 760.0 * 9.81 * 75.0;
        let w_iv = (p_ai / annulus * (p_ai - p_wi).max(zero)).sqrt() * 1.40e-4;
        let w_pc = u[0] * (rho_m * (p_wh - 15e5).max(zero)).sqrt() * 2.90e-3;
        let w_r = (-p_wb + 160e5).max(zero) * 2.47e-6;
        let share = x[1] / (x[1] + x[2]);
        dx[0] = u[1] - w_iv;
        dx[1] = w_iv - share * w_pc;
        dx[2] = w_r - (-share + 1.0) * w_pc;
    }
}

/// The steady state with a fifth of the choke open and 0.4 kg/s of gas.
const START: [f64; 3] = [3322.6, 312.0, 10787.0];

#[test]
fn pressures_as_algebraic_variables_or_eliminated() {
    let well = well();
    let eliminated: &dyn pinc_ode::DynRhs = &Eliminated;
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + b.abs());
    for k in 0..200 {
        // Also where no gas enters, and none leaves.
        let part = |rate: f64| (f64::from(k) * rate).fract();
        let x = [
            1500.0 + 3000.0 * part(0.618),
            50.0 + 500.0 * part(0.414),
            5000.0 + 15000.0 * part(0.732),
        ];
        let u = [part(0.236), 0.8 * part(0.645)];
        let (mut found, mut expected) = ([0.0; 3], [0.0; 3]);
        well.rhs(&x, &u, &[], &mut found);
        eliminated.rhs(&x, &u, &[], &mut expected);
        assert!(found.iter().zip(&expected).all(|(a, b)| close(*a, *b)), "{found:?} {expected:?}");
        let (found, expected) = (well.jacobian(&x, &u, &[]), eliminated.jacobian(&x, &u, &[]));
        assert!(found.iter().zip(&expected).all(|(a, b)| close(*a, *b)), "{found:?} {expected:?}");
    }
    let (mut found, mut expected) = (START, START);
    let mut truth = Dopri5::shared(well.to_shared(), 1e-11);
    let mut other = Dopri5::new(Eliminated, 1e-11);
    for u in [[0.5, 0.4], [0.3, 0.6], [0.8, 0.3]] {
        truth.integrate(&mut found, &u, 900.0).unwrap();
        other.integrate(&mut expected, &u, 900.0).unwrap();
        assert!(found.iter().zip(&expected).all(|(a, b)| close(*a, *b)), "{found:?} {expected:?}");
    }
}

/// The times in s at which gas begins to enter the tubing again, and the range of the pressure at
/// the bottom hole, in the second half of 20 hours.
fn open_loop(choke: f64) -> (Vec<f64>, [f64; 2]) {
    let well = well();
    let place = |name: &str| well.outputs().iter().position(|output| output.name == name).unwrap();
    let [annulus, foot, bottom] = ["p_annulus", "p_foot", "p_bottom"].map(place);
    let mut truth = Dopri5::shared(well.to_shared(), 1e-6);
    let (mut x, u) = (START, [choke, 0.4]);
    let mut y = vec![0.0; well.outputs().len()];
    let (mut starts, mut range, mut was_open) = (Vec::new(), [f64::INFINITY, 0.0_f64], true);
    for k in 1..=7200 {
        truth.integrate(&mut x, &u, 10.0).unwrap();
        truth.output(&x, &u, &mut y);
        let is_open = y[annulus] > y[foot];
        if k > 3600 {
            if is_open && !was_open {
                starts.push(10.0 * f64::from(k));
            }
            range = [range[0].min(y[bottom]), range[1].max(y[bottom])];
        }
        was_open = is_open;
    }
    (starts, range)
}

/// With half of the choke open gas enters in bursts of one period, with a fifth steadily.
#[test]
fn casing_heading_with_a_wide_choke_only() {
    let (starts, [low, high]) = open_loop(0.5);
    let periods: Vec<f64> = starts.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(periods.len() >= 3 && high - low > 50.0, "{starts:?} {low} {high}");
    assert!(periods.iter().all(|period| (period - periods[0]).abs() <= 20.0), "{periods:?}");
    let (starts, [low, high]) = open_loop(0.2);
    assert!(starts.is_empty() && high - low < 0.1, "{starts:?} {low} {high}");
}

#[test]
fn the_controller_holds_a_pressure_at_which_the_well_is_unstable() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("configs/oil-well/gas-lift.toml");
    let mut command =
        pinc(&["control".as_ref(), config.as_os_str(), "--only".as_ref(), "rk4".as_ref()]);
    let sets = [
        "control.duration_s=4800",
        "control.references=[{ start_s = 0.0, value = [88.0] }]",
        "control.repetitions=1",
        "control.n2=20",
        "control.plant_tolerance=1e-8",
    ];
    for set in sets {
        command.args(["--set", set]);
    }
    let outcome = outcome(command.arg("--out").arg(dir.path().join("run")));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let table = std::fs::read_to_string(dir.path().join("run/control.csv")).unwrap();
    let mut lines = table.lines();
    let place = lines.next().unwrap().split(',').position(|name| name == "p_bottom").unwrap();
    let last: Vec<f64> = lines
        .rev()
        .take(30)
        .map(|line| line.split(',').nth(place).unwrap().parse().unwrap())
        .collect();
    assert!(last.iter().all(|p| (p - 88.0).abs() < 0.3), "{last:?}");
}

/// The steady state that the program named in the config has for 50 Hz and half an opening, and its
/// pressure at the intake there; in SI units.
#[test]
fn the_pump_rests_where_the_program_with_its_parameters_does() {
    let pump = plant("pump.toml");
    let (p_bottom, p_head, q) =
        (8_311_024.821_757_59, 2_990_109.062_074_37, 0.009_950_422_413_517_8);
    let (x, u) = ([p_bottom / 1e5, p_head / 1e5, 3600.0 * q, 50.0, 50.0], [50.0, 50.0]);
    let mut rates = [f64::NAN; 5];
    pump.rhs(&x, &u, &[], &mut rates);
    // The program's last digit moves the pressures by less than 1e-11 bar/s.
    assert!(rates.iter().all(|rate| rate.abs() < 1e-9), "{rates:?}");
    let mut y = vec![f64::NAN; pump.outputs().len()];
    pump.output(&x, &u, &[], &mut y);
    let intake = pump.outputs().iter().position(|output| output.name == "p_intake").unwrap();
    assert!((y[intake] - 60.001_428_855_02).abs() < 1e-9, "{y:?}");
    // Half of the drive's way in 1.4 s, and the pressure falls with more speed.
    let faster = [60.0, 50.0];
    let (mut truth, mut x) = (AccurateIntegrator::shared(pump.to_shared(), 1e-9), x);
    truth.integrate(&mut x, &faster, 2.0 * 2.0_f64.ln()).unwrap();
    assert!((x[3] - 55.0).abs() < 1e-7, "{x:?}");
    truth.integrate(&mut x, &faster, 100.0).unwrap();
    truth.output(&x, &faster, &mut y);
    assert!((y[intake] - 47.353).abs() < 1e-3, "{y:?}");
}

#[test]
fn the_controller_holds_the_pressure_at_the_intake_of_the_pump() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("configs/oil-well/pump.toml");
    let mut command =
        pinc(&["control".as_ref(), config.as_os_str(), "--only".as_ref(), "rk4".as_ref()]);
    for set in ["control.duration_s=60", "control.repetitions=1"] {
        command.args(["--set", set]);
    }
    let outcome = outcome(command.arg("--out").arg(dir.path().join("run")));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let table = std::fs::read_to_string(dir.path().join("run/control.csv")).unwrap();
    let names: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let column = |name: &str| -> Vec<f64> {
        let place = names.iter().position(|other| *other == name).unwrap();
        let value = |line: &str| line.split(',').nth(place).unwrap().parse().unwrap();
        table.lines().skip(1).map(value).collect()
    };
    let held = column("p_intake");
    assert!(held.iter().rev().take(100).all(|p| (p - 48.0).abs() < 0.01), "{held:?}");
    let thrust = column("thrust");
    assert!(thrust.iter().all(|thrust| (0.0..=100.0).contains(thrust)), "{thrust:?}");
}
