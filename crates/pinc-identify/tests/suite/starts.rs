//! Fits from several starts.

use crate::support::{noise, oscillator, plant, problem, simulated, steps};
use pinc_identify::{
    Diagnosis, FitStatus, Identified, IdentifyError, InitialState, Problem, Recording, Starts,
    identify, identify_from_starts,
};
use pinc_ode::{Dims, DynPlant, Integrator, Linearization, Model, Stages};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Two tanks in a row, of which the upper one has an overflow at `level`; the lower one is measured.
fn cascade() -> Box<dyn DynPlant> {
    plant(
        &[
            ("h1", "gain*u - out*sqrt(max(h1, 0.01)) - spill*max(h1 - level, 0)^2"),
            (
                "h2",
                "out*sqrt(max(h1, 0.01)) - 0.6*sqrt(max(h2, 0.01)) + 0.5*spill*max(h1 - level, 0)^2",
            ),
        ],
        &["u"],
        &[("gain", 1.0), ("level", 6.0), ("out", 0.5), ("spill", 0.8)],
        &["gain", "level", "out", "spill"],
    )
}

/// Sorted by name, as the plant has them.
const TRUTH: [f64; 4] = [1.0, 6.0, 0.5, 0.8];

/// What the fit begins with: an overflow at `level`.
fn from_level(plant: &dyn DynPlant, level: f64) -> Problem {
    let start = [(1.2, 0.2, 4.0), (level, 2.0, 20.0), (0.4, 0.1, 2.0), (0.5, 0.1, 3.0)];
    problem(plant, &[1], Some(0.002), &start, InitialState::Fixed(vec![2.0, 2.0]))
}

/// Inputs that fill the upper tank to 9 if nothing runs over, with what is measured then.
fn data(plant: &dyn DynPlant) -> (Vec<f64>, Vec<f64>) {
    let u = steps(11, 160, 20, (0.4, 1.6));
    let x = simulated(&mut *plant.model(Integrator::Rk4, 0.5, 2).unwrap(), &[2.0, 2.0], &u, &TRUTH);
    assert!(x.chunks(2).any(|x| x[0] > 6.3) && x.chunks(2).all(|x| x[0] < 19.0));
    let y = x.chunks(2).map(|x| x[1]).zip(noise(4, 0.002, 160)).map(|(x, e)| x + e).collect();
    (u, y)
}

fn copies(plant: &dyn DynPlant, count: usize) -> Vec<Box<dyn Model>> {
    (0..count).map(|_| plant.model(Integrator::Rk4, 0.5, 2).unwrap()).collect()
}

fn fit(plant: &dyn DynPlant, level: f64, starts: usize, threads: usize) -> Identified {
    let (u, y) = data(plant);
    let recording = Recording { name: "cascade", before: None, u: &u, y: &y };
    let problem = from_level(plant, level);
    let of = Starts { seed: 1, threads, ..Starts::default() };
    identify_from_starts(copies(plant, starts), &problem, &[recording], of).unwrap()
}

/// With an overflow far above all levels nothing tells of it, and the fit ends where it cannot.
#[test]
fn an_overflow_that_one_start_never_reaches_is_found_from_many() {
    let plant = cascade();
    let single = fit(&*plant, 20.0, 1, 1);
    let (u, y) = data(&*plant);
    let recording = Recording { name: "cascade", before: None, u: &u, y: &y };
    assert_eq!(single.parameters[1].value.to_bits(), 20.0_f64.to_bits());
    // Both act as soon as the level is within reach; that the data cannot tell them is not said.
    let inactive = single.findings.iter().filter_map(|finding| match finding {
        Diagnosis::Inactive { name, acts_at } => Some((name.as_str(), acts_at.clone())),
        _ => None,
    });
    let inactive: Vec<_> = inactive.collect();
    assert_eq!(inactive.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["level", "spill"]);
    for (_, acts_at) in &inactive {
        assert_eq!([&*acts_at[0].0, &*acts_at[1].0], ["level", "spill"]);
        assert!((2.0..15.0).contains(&acts_at[0].1), "{acts_at:?}");
        assert!((0.1..=3.0).contains(&acts_at[1].1), "{acts_at:?}");
    }
    // 20 is its bound, but the data do not ask for more.
    let silent = |finding: &Diagnosis| {
        matches!(finding, Diagnosis::NoInfluence { .. } | Diagnosis::AtBound { .. })
    };
    assert!(!single.findings.iter().any(silent), "{:?}", single.findings);
    let said = single.findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    assert!(said.contains("level does not act along the fitted trajectory"), "{said}");

    let found = fit(&*plant, 20.0, 16, 2);
    assert_eq!(found.status, FitStatus::Converged);
    assert!(found.cost < 0.5 * single.cost, "{} {}", found.cost, single.cost);
    for (estimate, truth) in found.parameters.iter().zip(TRUTH) {
        let width = estimate.half_width.unwrap();
        assert!((estimate.value - truth).abs() < 2.0 * width, "{estimate:?}");
        assert!(width < 0.15 * truth, "{estimate:?}");
    }
    // It is the minimum that the fit from the truth has.
    let near = identify(
        &mut *plant.model(Integrator::Rk4, 0.5, 2).unwrap(),
        &from_level(&*plant, 6.0),
        &[recording],
    )
    .unwrap();
    assert!((near.cost - found.cost).abs() < 1e-8 * near.cost, "{} {}", near.cost, found.cost);
    // All starts are listed, the best first, with the own start where it ended alone.
    assert_eq!(found.starts.len(), 16);
    assert!(found.starts[1..].is_sorted_by(|a, b| a.cost <= b.cost));
    assert!(found.cost <= (1.0 + 1e-6) * found.starts[1].cost);
    assert_eq!(found.starts[0].cost.to_bits(), found.cost.to_bits());
    let fitted: Vec<f64> = found.parameters.iter().map(|of| of.value).collect();
    assert_eq!(found.starts[0].parameters, fitted);
    let own = found.starts.iter().find(|start| start.parameters[1] >= 20.0).unwrap();
    assert_eq!(own.cost.to_bits(), single.cost.to_bits());
    assert_eq!(own.status, Some(FitStatus::Converged));
    let (same, ended) = found.agreeing_starts();
    assert_eq!(ended, 5);
    assert!((1..=4).contains(&same), "{same}");
    let close = |cost: f64| cost <= (1.0 + 1e-6) * found.cost;
    let count = found.starts.iter().filter(|of| of.status.is_some() && close(of.cost)).count();
    assert_eq!(same, count);
    assert!(found.work.steps > single.work.steps);
}

/// A start that is as good as any stays what is returned, to the bit.
#[test]
fn the_own_start_has_the_same_bits_alone_and_among_others() {
    let plant = cascade();
    let (u, y) = data(&*plant);
    let recording = Recording { name: "cascade", before: None, u: &u, y: &y };
    let problem = from_level(&*plant, 7.0);
    let alone =
        identify(&mut *plant.model(Integrator::Rk4, 0.5, 2).unwrap(), &problem, &[recording])
            .unwrap();
    assert_eq!(alone.starts.len(), 1);
    assert_eq!(alone.agreeing_starts(), (1, 1));
    let bits = |of: &Identified| -> Vec<u64> {
        let of = of.parameters.iter().flat_map(|of| [of.value, of.half_width.unwrap()]);
        of.map(f64::to_bits).collect()
    };
    let one = fit(&*plant, 7.0, 1, 2);
    assert_eq!((bits(&one), one.work), (bits(&alone), alone.work));
    let many = fit(&*plant, 7.0, 6, 2);
    assert_eq!(bits(&many), bits(&alone));
    assert!(many.agreeing_starts().0 >= 2, "{:?}", many.starts);
}

#[test]
fn the_result_does_not_depend_on_threads_but_on_the_seed() {
    let plant = oscillator();
    let u = steps(7, 60, 15, (-1.0, 1.0));
    let y = simulated(
        &mut *plant.model(Integrator::Rk4, 0.1, 2).unwrap(),
        &[1.0, 0.0],
        &u,
        &[0.8, 1.3],
    );
    let start = [(0.5, 0.0, 5.0), (1.0, 0.1, 20.0)];
    let free = InitialState::Free(vec![1.0, 0.0]);
    let problem = problem(&*plant, &[0, 1], None, &start, free);
    let starts = |seed: u64, threads: usize| {
        let models = (0..6).map(|_| plant.model(Integrator::Rk4, 0.1, 2).unwrap()).collect();
        let recording = Recording { name: "oscillator", before: None, u: &u, y: &y };
        let of = Starts { seed, threads, ..Starts::default() };
        identify_from_starts(models, &problem, &[recording], of).unwrap().starts
    };
    assert_eq!(starts(1, 1), starts(1, 3));
    assert_ne!(starts(1, 2), starts(2, 2));
}

/// A model that sets `interrupt` when it is linearized first.
#[derive(Debug)]
struct Interrupting {
    model: Box<dyn Model>,
    interrupt: Arc<AtomicBool>,
    linearized: Arc<AtomicUsize>,
}

impl Model for Interrupting {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.model.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.interrupt.store(true, Ordering::Relaxed);
        self.linearized.fetch_add(at.count(self.dims()), Ordering::Relaxed);
        self.model.linearize(at, out);
    }
}

/// A fit ends within the iteration in which it is interrupted, and no other start begins.
#[test]
fn an_interrupted_fit_ends() {
    let plant = cascade();
    let (u, y) = data(&*plant);
    for (starts, sets) in [(1, true), (100, true), (3, false)] {
        let interrupt = Arc::new(AtomicBool::new(false));
        let linearized = Arc::new(AtomicUsize::new(0));
        let copy = |model| -> Box<dyn Model> {
            Box::new(Interrupting {
                model,
                interrupt: interrupt.clone(),
                linearized: linearized.clone(),
            })
        };
        let models = copies(&*plant, starts).into_iter().map(copy).collect();
        let recording = Recording { name: "cascade", before: None, u: &u, y: &y };
        let of = Starts { interrupt: sets.then_some(&*interrupt), ..Starts::default() };
        let found = identify_from_starts(models, &from_level(&*plant, 8.0), &[recording], of);
        let passes = linearized.load(Ordering::Relaxed) / 160;
        assert_eq!(found.err(), sets.then_some(IdentifyError::Interrupted), "{starts}");
        assert!(if sets { passes <= 2 } else { passes > 6 }, "{starts}: {passes}");
    }
}

#[test]
fn several_starts_need_bounds() {
    let plant = oscillator();
    let start = [(0.5, 0.0, 5.0), (1.0, 0.1, f64::INFINITY)];
    let problem = problem(&*plant, &[0, 1], None, &start, InitialState::Fixed(vec![1.0, 0.0]));
    let recording = Recording { name: "none", before: None, u: &[0.0; 5], y: &[1.0; 10] };
    let starts = |count: usize| {
        let models = (0..count).map(|_| plant.model(Integrator::Rk4, 0.1, 2).unwrap()).collect();
        identify_from_starts(models, &problem, &[recording], Starts::default())
    };
    let refused = IdentifyError::NoBounds { name: "k".to_owned(), starts: 3 };
    assert_eq!(starts(3).unwrap_err(), refused);
    starts(1).unwrap();
}

/// A parameter on which nothing depends anywhere is called that.
#[test]
fn a_parameter_that_acts_nowhere_is_told_from_one_that_is_inactive() {
    let states = [("x", "r*(u - x) + 0*s")];
    let plant = plant(&states, &["u"], &[("r", 1.0), ("s", 1.0)], &["r", "s"]);
    let u = steps(3, 60, 10, (0.0, 1.0));
    let y = simulated(&mut *plant.model(Integrator::Rk4, 0.2, 2).unwrap(), &[0.0], &u, &[0.7, 1.0]);
    let start = [(1.0, 0.1, 3.0), (1.0, 0.0, 2.0)];
    let problem = problem(&*plant, &[0], None, &start, InitialState::Fixed(vec![0.0]));
    let recording = Recording { name: "lag", before: None, u: &u, y: &y };
    let found =
        identify(&mut *plant.model(Integrator::Rk4, 0.2, 2).unwrap(), &problem, &[recording])
            .unwrap();
    assert_eq!(found.findings, [Diagnosis::NoInfluence { name: "s".to_owned() }]);
}
