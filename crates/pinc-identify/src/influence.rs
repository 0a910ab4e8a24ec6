//! Whether a parameter without influence at the end of a fit has some elsewhere.

use crate::fit::Fit;
use crate::points;
use crate::problem::Problem;
use crate::result::outputs;
use crate::trajectory::{Evaluation, Trajectory};

/// How many values of the parameters are tried.
const POINTS: usize = 32;
/// A change of this share of a measured quantity's size is more than rounding.
const CHANGE: f64 = 1e-9;

/// For each of the unknown parameters `silent`, values of all of these, in their order, with which
/// it changes something measured; `None` if it does at none of the points that are tried. The
/// other unknowns stay as they were fitted.
pub(crate) fn acting_elsewhere(
    problem: &Problem,
    fit: &Fit<'_>,
    silent: &[usize],
    with: &mut Evaluation<'_>,
) -> Vec<Option<Vec<f64>>> {
    let mut found = vec![None; silent.len()];
    let place = |k: usize| problem.unknown[silent[k]].place;
    for point in 0..POINTS {
        if found.iter().all(Option::is_some) {
            break;
        }
        let values = points::point(silent.iter().map(|&i| &problem.unknown[i]), point, 0);
        let mut p = fit.p.clone();
        for (k, value) in values.iter().enumerate() {
            p[place(k)] = *value;
        }
        let here = measured(problem, fit, &p, with);
        for k in (0..silent.len()).filter(|&k| found[k].is_none()).collect::<Vec<_>>() {
            let mut without = p.clone();
            without[place(k)] = fit.p[place(k)];
            if differ(&here, &measured(problem, fit, &without, with)) {
                found[k] = Some(values.clone());
            }
        }
    }
    found
}

/// All that is measured along the recordings, from the initial states that were fitted.
fn measured(problem: &Problem, fit: &Fit<'_>, p: &[f64], with: &mut Evaluation<'_>) -> Vec<f64> {
    let nx = with.dims.nx;
    let mut all = Vec::new();
    for of in &fit.recordings {
        let mut to = Trajectory::new(nx, of.trajectory.x.len() / nx, 1);
        with.simulate(problem, of.recording, (&[0], &of.nodes.x[..nx], p), &mut to);
        all.extend(outputs(problem, of.recording, (&to, p), with));
    }
    all
}

fn differ(a: &[f64], b: &[f64]) -> bool {
    let pairs = a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite());
    pairs.clone().any(|(a, b)| (a - b).abs() > CHANGE * a.abs().max(b.abs()))
}
