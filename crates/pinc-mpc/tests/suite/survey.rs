//! Random states and references, feasible or not, with deadlines and models that fail: an input
//! within its bounds each time, and a status that is true.
//!
//! `PINC_RANDOM_STEPS=100000` in the environment of a test takes so many steps.

use crate::faulty::{Faulty, NOT_A_NUMBER, SOUND, WRONG};
use crate::optimality::{StepInput, residuals, scale};
use crate::stream::Stream;
use pinc_mpc::{Nmpc, NmpcProblem, SqpConfig, SqpStatus};
use pinc_ode::Model;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Steps per plant, unless the environment says otherwise.
const STEPS: usize = 2000;

/// What is drawn: intervals of the states and of the references.
pub(crate) struct Draw<'a> {
    pub(crate) states: &'a [[f64; 2]],
    pub(crate) references: &'a [[f64; 2]],
}

/// Takes the steps, and counts how they end: those with a sound model and without deadline first,
/// then the others.
pub(crate) fn survey(
    mut sound: impl Model + Clone + 'static,
    problem: &NmpcProblem,
    draw: &Draw<'_>,
) -> [BTreeMap<SqpStatus, usize>; 2] {
    let fault = Arc::new(AtomicU64::new(SOUND));
    let model = Faulty { model: sound.clone(), fault: Arc::clone(&fault) };
    let mut nmpc = Nmpc::new(problem.clone(), Box::new(model), SqpConfig::default()).unwrap();
    let mut stream = Stream::new(1);
    let mut seen = [BTreeMap::new(), BTreeMap::new()];
    let mut previous = vec![0.0; sound.dims().nu];
    let steps = std::env::var("PINC_RANDOM_STEPS").map_or(STEPS, |n| n.parse().unwrap());
    for k in 0..steps {
        let x: Vec<f64> = draw.states.iter().map(|&range| stream.within(range)).collect();
        let y: Vec<f64> = draw.references.iter().map(|&range| stream.within(range)).collect();
        let y = y.repeat(problem.horizon);
        // One step in four has a deadline, one in eight each fault.
        let mut time = if stream.below(4) == 0 { stream.below(4) } else { u64::MAX };
        let limited = time < u64::MAX;
        let what = stream.below(8);
        fault.store(what, Ordering::Relaxed);
        let mut expired = || {
            time = time.saturating_sub(1);
            time == 0
        };
        let report = nmpc.step_within(&x, &y, &mut expired).unwrap();
        let (status, u) = (report.status, report.u.to_vec());
        let (kkt, violated) = (report.kkt, report.violated);
        for (c, u) in u.iter().enumerate() {
            let bounds = problem.input_bounds.low[c]..=problem.input_bounds.high[c];
            assert!(bounds.contains(u), "step {k}: {u}");
        }
        let faultless = !matches!(what, NOT_A_NUMBER | WRONG);
        *seen[usize::from(limited || !faultless)].entry(status).or_default() += 1;
        assert!(status != SqpStatus::Converged || kkt.max() <= 1e-8, "step {k}: {kkt:?}");
        assert!(status != SqpStatus::InfeasibleQp || violated.is_some(), "step {k}");
        assert!(
            what != NOT_A_NUMBER || status == SqpStatus::NumericalTrouble,
            "step {k}: {status}"
        );
        if faultless && status == SqpStatus::Converged {
            let input = StepInput { x: &x, previous: &previous, reference: &y };
            let [stationarity, dynamics, bounds, products] = residuals(&nmpc, &mut sound, &input);
            let s = scale(&nmpc);
            let found = [stationarity / s, dynamics, bounds, products / s];
            assert!(found.iter().all(|&r| r <= 1.0001e-8), "step {k}: {found:?}");
        }
        previous = u;
    }
    seen
}

/// How many of the steps ended so.
pub(crate) fn share(seen: &BTreeMap<SqpStatus, usize>, statuses: &[SqpStatus]) -> f64 {
    let count = |statuses: &mut dyn Iterator<Item = &SqpStatus>| -> f64 {
        statuses.filter_map(|status| seen.get(status)).sum::<usize>() as f64
    };
    count(&mut statuses.iter()) / count(&mut seen.keys())
}
