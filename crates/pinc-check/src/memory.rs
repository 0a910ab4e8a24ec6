//! Checks a black box for hidden memory: one step of T against two of T/2, and two steps that begin anew
//! against two in one run.

use crate::numbers::{named, short};
use crate::{Finding, Subject, region};
use pinc_analysis::OperatingPoint;
use pinc_config::{Experiment, TimeUnit};
use pinc_ode::{BlackBox, DynRhs, OdeError};

/// Points at which an examination compares.
const POINTS: usize = 16;

/// Points that are compared before a loop, where it must not take long.
const FEW: usize = 3;

/// Points where the simulator may fail before no more are tried.
const MOST_FAILURES: usize = 4;

/// A difference of this share of the largest change of a state in a step is no error of an
/// integrator.
const SHARE: f64 = 0.01;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let (Some(plant), Some(step_s)) =
        (subject.models.black_box(), subject.experiment.sample_time_s())
    else {
        return Vec::new();
    };
    let points: Vec<_> = subject.region.points(subject.experiment.seed).take(POINTS).collect();
    let Some(worst) = worst(plant, &points, step_s) else { return Vec::new() };
    vec![if worst.share > SHARE {
        worst.warning(plant, subject.experiment)
    } else {
        let what = format!(
            "two steps of T/2 end where one of T does, to {} % of a step's change: no memory \
             beside the states is seen",
            short(100.0 * worst.share)
        );
        Finding::fact("plant", what)
    }]
}

/// The warning before a loop with a black box whose steps of T/2 do not make a step of T. A few
/// points are compared.
#[must_use]
pub fn hidden_memory(plant: &dyn DynRhs, experiment: &Experiment) -> Option<Finding> {
    let (plant, step_s) = (plant.black_box()?, experiment.sample_time_s()?);
    let (region, _) = region::of(experiment, plant.dims())?;
    let points: Vec<_> = region.points(experiment.seed).take(FEW).collect();
    let worst = worst(plant, &points, step_s)?;
    (worst.share > SHARE).then(|| worst.warning(plant, experiment))
}

/// What is compared with steps that begin anew.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    /// Two steps of T/2 with one of T.
    Halves,
    /// Two steps of T in one run with two that begin anew.
    OneRun,
}

/// By how much each state is off.
type Difference = (Way, Vec<f64>);

/// The largest difference of the two, in shares of the largest change of its state in a step.
struct Worst {
    way: Way,
    share: f64,
    state: usize,
    difference: f64,
    point: OperatingPoint,
}

/// Compares at `points`, where the simulator gives both; `None` if it does nowhere.
fn worst(plant: &BlackBox, points: &[OperatingPoint], step_s: f64) -> Option<Worst> {
    let mut changes = vec![0.0_f64; plant.dims().nx];
    let mut differences = Vec::new();
    let mut failures = 0;
    for point in points {
        match ends(plant, point, step_s) {
            Ok((whole, found)) => {
                for (change, (end, start)) in changes.iter_mut().zip(whole.iter().zip(&point.x)) {
                    *change = change.max((end - start).abs());
                }
                differences.extend(found.into_iter().map(|(way, found)| (point, way, found)));
            }
            Err(_) => failures += 1,
        }
        if failures == MOST_FAILURES {
            break;
        }
    }
    let all = differences.iter().flat_map(|(point, way, found)| {
        found.iter().enumerate().map(|(state, difference)| {
            // A state that never changes differs by rounding only.
            let change = changes[state].max(1e-9 * point.x[state].abs()).max(f64::MIN_POSITIVE);
            let (share, difference) = (difference.abs() / change, *difference);
            Worst { way: *way, share, state, difference, point: (*point).clone() }
        })
    });
    all.max_by(|one, other| one.share.total_cmp(&other.share))
}

/// The states that follow a point after one step, and how far off others are that should be the same.
fn ends(
    plant: &BlackBox,
    point: &OperatingPoint,
    step_s: f64,
) -> Result<(Vec<f64>, Vec<Difference>), OdeError> {
    let OperatingPoint { x, u } = point;
    let twice = |step_s: f64| {
        let mut end = x.clone();
        plant.flow.advance(&mut end, u, step_s)?;
        plant.flow.advance(&mut end, u, step_s).map(|()| end)
    };
    let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
    let mut whole = x.clone();
    plant.flow.advance(&mut whole, u, step_s)?;
    let mut found = vec![(Way::Halves, minus(&twice(0.5 * step_s)?, &whole))];
    let mut one_run = x.clone();
    if let Some(advanced) = plant.flow.advance_in_one_run(&mut one_run, u, step_s, 2) {
        advanced?;
        found.push((Way::OneRun, minus(&one_run, &twice(step_s)?)));
    }
    Ok((whole, found))
}

impl Worst {
    fn warning(&self, plant: &BlackBox, experiment: &Experiment) -> Finding {
        let step_s = experiment.sample_time_s().unwrap_or(1.0);
        let half = TimeUnit::shown(0.5 * step_s, experiment.time_unit);
        let names = plant.states().iter().chain(plant.inputs()).map(|v| v.name.as_ref());
        let way = match self.way {
            Way::Halves => format!("two steps of T/2 = {half} do not end where one step of T does"),
            Way::OneRun => {
                "two steps of T in one run do not end where two do that begin anew".to_owned()
            }
        };
        let what = format!(
            "{way}: {} differs by {} from {}, which is {} % of its largest change in a step",
            plant.states()[self.state].name,
            short(self.difference),
            named(names, &self.point.joined()),
            short(100.0 * self.share)
        );
        Finding::warning("plant", what)
            .because(
                "each step begins anew with the states alone: what else the simulator remembers, \
                 and its time, are reset, so model and loop describe another plant",
            )
            .change(
                "make all that the simulator remembers a state, and its equations independent of \
                 time; a simulator with internal steps of a fixed length needs a T whose half is a \
                 whole number of them",
            )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::Plants;
    use pinc_ode::{Flow, Variable};
    use std::sync::Arc;

    /// Two states whose flow over a time is a function of state, input and time.
    #[derive(Debug)]
    struct By(fn(f64, f64, f64) -> f64);

    impl Flow for By {
        fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
            for (x, u) in x.chunks_exact_mut(2).zip(u) {
                if x[0] < 0.0 {
                    return Err(OdeError::External { reason: "below 0".to_owned() });
                }
                // Exact, and ten times as fast as the other.
                x[0] *= (-10.0 * duration_s).exp();
                x[1] = self.0(x[1], *u, duration_s);
            }
            Ok(())
        }
    }

    fn black_box(flow: fn(f64, f64, f64) -> f64) -> BlackBox {
        BlackBox {
            states: vec![Variable::new("a", ""), Variable::new("b", "")],
            inputs: vec![Variable::new("u", "")],
            outputs: Vec::new(),
            difference_steps: vec![1e-6; 3],
            flow: Arc::new(By(flow)),
        }
    }

    fn point(x: [f64; 2], u: f64) -> OperatingPoint {
        OperatingPoint { x: x.to_vec(), u: vec![u] }
    }

    /// x' = z - x with a lag z' = 2 (u - z) that nobody names and that begins at 0.
    fn lagged(x: f64, u: f64, t: f64) -> f64 {
        let (slow, fast) = ((-t).exp(), (-2.0 * t).exp());
        x * slow + u * (1.0 - slow + fast - slow)
    }

    fn exact(x: f64, u: f64, t: f64) -> f64 {
        u + (x - u) * (-t).exp()
    }

    #[test]
    fn a_hidden_lag_is_found_where_it_is_largest() {
        let points = [point([0.5, 1.0], 0.0), point([-1.0, 0.0], 5.0), point([0.5, 0.2], 2.0)];
        let found = worst(&black_box(lagged), &points, 0.5).unwrap();
        let whole = lagged(0.2, 2.0, 0.5);
        let halves = lagged(lagged(0.2, 2.0, 0.25), 2.0, 0.25);
        // The largest change is that from the first point, where the lag does nothing.
        let change = 1.0 - (-0.5_f64).exp();
        assert_eq!((found.state, &found.point), (1, &points[2]));
        assert!((found.difference - (halves - whole)).abs() < 1e-15, "{}", found.difference);
        assert!((found.share - (whole - halves).abs() / change).abs() < 1e-14, "{}", found.share);
        assert!(found.share > 0.1, "{}", found.share);
        assert!(worst(&black_box(exact), &points, 0.5).unwrap().share < 1e-12);
        assert!(worst(&black_box(exact), &points[1..2], 0.5).is_none());
    }

    /// x' = u, and a counter of steps that acts on it as long as a run lasts.
    #[derive(Debug)]
    struct Counting;

    impl Flow for Counting {
        fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
            self.advance_in_one_run(x, u, duration_s, 1).expect("it has runs")
        }

        fn advance_in_one_run(
            &self,
            x: &mut [f64],
            u: &[f64],
            duration_s: f64,
            times: u32,
        ) -> Option<Result<(), OdeError>> {
            x[1] += (0..times).map(|k| (u[0] + 0.1 * f64::from(k)) * duration_s).sum::<f64>();
            Some(Ok(()))
        }
    }

    /// Two steps of T/2 that begin anew make one of T.
    #[test]
    fn what_is_carried_from_step_to_step_is_found() {
        let counting = BlackBox { flow: Arc::new(Counting), ..black_box(exact) };
        let found = worst(&counting, &[point([0.5, 1.0], 2.0)], 0.5).unwrap();
        assert_eq!((found.way, found.state), (Way::OneRun, 1));
        // 0.1 T, of a change of 2 T.
        assert!((found.share - 0.05).abs() < 1e-12, "{}", found.share);
        let said = found.warning(&counting, &experiment()).what;
        assert!(said.starts_with("two steps of T in one run do not end where"), "{said}");
    }

    fn experiment() -> Experiment {
        let text = "name = \"t\"\npreset = \"ours\"\nseed = 1\n\
            plant = { van-der-pol = { mu = 1.0 } }\n\
            [model]\nhorizon_s = 0.5\nhidden_layers = 1\nneurons = 4\n\
            [domain]\nstate_low = [0.0, 0.0]\nstate_high = [1.0, 2.0]\n\
            input_low = [1.0]\ninput_high = [1.0000001]\n";
        Experiment::parse("t.toml".as_ref(), text, &[], &Plants::built_in()).unwrap()
    }

    /// A step of T goes T (1 + k T) far, two of T/2 T (1 + k T/2): for T = 0.5 their difference is
    /// 0.25 k / (1 + 0.5 k) of the step.
    #[test]
    fn a_difference_of_more_than_a_hundredth_is_a_warning() {
        let said = |flow| hidden_memory(&black_box(flow), &experiment());
        assert_eq!(said(|x, u, t| x + u * t * (1.0 + 0.038 * t)), None);
        let found = said(|x, u, t| x + u * t * (1.0 + 0.044 * t)).unwrap();
        let begin = "two steps of T/2 = 0.25 s do not end where one step of T does: b differs by \
                     -0.0055 from a = ";
        assert!(found.what.starts_with(begin), "{found}");
        assert!(found.what.contains("u = 1, which is 1.07632 % of"), "{found}");
    }
}
