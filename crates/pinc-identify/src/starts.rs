//! A fit from several starts.

use crate::fit::{Fit, FitStatus};
use crate::identify::{Begun, checked, from_own_start};
use crate::method::Method;
use crate::problem::{Problem, Recording, Unknown};
use crate::result::Identified;
use crate::trajectory::{Evaluation, Work, is_set};
use crate::{IdentifyError, points};
use pinc_ode::Model;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// The starts of a fit whose parameters all have bounds.
const STARTS: usize = 16;
/// Iterations of each start before the best ones are chosen.
const SHORT: usize = 10;
/// The share by which the costs of fits differ that ended in the same minimum.
const SAME: f64 = 1e-6;

impl Problem {
    /// How many starts a fit has if none are asked for: several only where bounds say between what.
    #[must_use]
    pub fn default_starts(&self) -> usize {
        let several = !self.unknown.is_empty() && self.unknown.iter().all(Unknown::is_bounded);
        if several { STARTS } else { 1 }
    }
}

/// How a fit uses its starts.
#[derive(Clone, Copy, Debug)]
pub struct Starts<'a> {
    /// What scrambles the points.
    pub seed: u64,
    /// How many of the best are fitted to the end, beside the problem's own start.
    pub finished: usize,
    /// The largest number of threads.
    pub threads: usize,
    /// What ends the fit once it is set, with [`IdentifyError::Interrupted`].
    pub interrupt: Option<&'a AtomicBool>,
}

impl Default for Starts<'_> {
    fn default() -> Self {
        Self { seed: 0, finished: 4, threads: 1, interrupt: None }
    }
}

/// Where a fit from one start ended.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Start {
    /// The cost there; infinite if the model is not finite.
    pub cost: f64,
    /// The unknown parameters there, in the order of the problem, and then K, row by row.
    pub parameters: Vec<f64>,
    /// How the fit ended; `None` if it was set aside after a short fit, since others were better.
    pub status: Option<FitStatus>,
}

impl Start {
    pub(crate) fn of(problem: &Problem, fit: &Fit<'_>) -> Self {
        let cost = fit.cost();
        Self {
            cost: if cost.is_finite() { cost } else { f64::INFINITY },
            parameters: problem.unknown.iter().map(|unknown| fit.p[unknown.place]).collect(),
            status: Some(fit.status),
        }
    }
}

/// A start after its short fit, with the model that it is fitted with.
struct Attempt<'a> {
    model: Box<dyn Model>,
    begun: Begun<'a>,
    /// The cost; infinite where single shooting cannot begin.
    cost: f64,
    work: Work,
}

/// A start at its end.
struct Ended<'a> {
    start: Start,
    /// Its fit, unless it was set aside or had none.
    fit: Option<(Box<dyn Model>, Fit<'a>, Method)>,
    /// Why it had none.
    error: Option<IdentifyError>,
    work: Work,
}

/// Like [`identify`](crate::identify()), from as many starts as there are `models`, which are copies
/// of one model: the problem's own start, and points of a Sobol sequence within the bounds of the
/// unknown parameters, scrambled by the seed. Parameters whose bounds are positive and at least
/// tenfold apart are spread evenly in the logarithm; those with a prior within its standard deviation
/// times root 3.
///
/// Each start has a short fit. The best few, and the problem's own start, are fitted to the end,
/// and the best of these is returned; [`Identified::starts`] has them all. Fits run side by side on
/// threads. The result does not depend on their number, and with one model it
/// equals that of `identify`.
///
/// # Errors
///
/// As `identify`, [`IdentifyError::NoBounds`] if there are several starts and a parameter has an
/// infinite bound and no prior, and [`IdentifyError::Interrupted`].
///
/// # Panics
///
/// If there is no model, or if a method of one does.
pub fn identify_from_starts(
    mut models: Vec<Box<dyn Model>>,
    problem: &Problem,
    recordings: &[Recording<'_>],
    with: Starts<'_>,
) -> Result<Identified, IdentifyError> {
    let starts = models.len();
    if starts == 1 {
        return from_own_start(
            Evaluation::new(&mut *models[0]).until(with.interrupt),
            problem,
            recordings,
        );
    }
    let problem = &*checked(problem, recordings, &mut Evaluation::new(&mut *models[0]))?;
    if let Some(unknown) = problem.of_the_model().iter().find(|unknown| !unknown.is_bounded()) {
        return Err(IdentifyError::NoBounds { name: unknown.name.clone(), starts });
    }
    let tasks = models.into_iter().enumerate().collect();
    let mut attempts = side_by_side(tasks, with, |(i, model)| {
        Attempt::at(start(problem, i, with.seed), model, (problem, recordings), with.interrupt)
    })?;
    let simulated = attempts[0].begun.start.clone();
    attempts[1..].sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let good = attempts[1..].iter().take(with.finished).filter(|of| of.cost.is_finite()).count();
    let aside = attempts.split_off(1 + good);
    let mut ends =
        side_by_side(attempts, with, |of| of.finish(problem, recordings, with.interrupt))?;
    ends.extend(aside.into_iter().map(|of| of.set_aside(problem)));
    let work = ends.iter().fold(Work::default(), |sum, of| sum.plus(of.work));
    let best = match best(&ends) {
        Some(place) => ends.remove(place),
        None => return Err(ends.remove(0).error.expect("the first start was fitted to the end")),
    };
    ends.sort_by(|a, b| a.start.cost.total_cmp(&b.start.cost));
    let starts = std::iter::once(best.start).chain(ends.into_iter().map(|of| of.start)).collect();
    let (mut model, fit, method) = best.fit.expect("the best start was fitted to the end");
    let mut with = Evaluation::new(&mut *model).until(with.interrupt);
    with.work = work;
    Ok(Identified::of(problem, (fit, method), starts, &simulated, &mut with))
}

/// The parameters of the model at start `i`.
fn start(problem: &Problem, i: usize, seed: u64) -> Vec<f64> {
    let mut p = problem.start();
    if i > 0 {
        let point = points::point(problem.of_the_model().iter(), i - 1, seed);
        for (unknown, value) in problem.of_the_model().iter().zip(point) {
            p[unknown.place] = value;
        }
    }
    p
}

impl<'a> Attempt<'a> {
    fn at(
        p: Vec<f64>,
        mut model: Box<dyn Model>,
        (problem, recordings): (&Problem, &[Recording<'a>]),
        interrupt: Option<&AtomicBool>,
    ) -> Self {
        let mut with = Evaluation::new(&mut *model).until(interrupt);
        let mut begun = Begun::at(p, problem, recordings, &mut with);
        if begun.is_single(problem.criterion) {
            begun.fit.run_until(SHORT, problem, &mut with);
        }
        let cost =
            if begun.is_single(problem.criterion) { begun.fit.cost() } else { f64::INFINITY };
        let work = with.work;
        Self { model, begun, cost, work }
    }

    fn finish(
        self,
        problem: &Problem,
        recordings: &[Recording<'a>],
        interrupt: Option<&AtomicBool>,
    ) -> Ended<'a> {
        let Self { mut model, begun, work, .. } = self;
        let begin = Start::of(problem, &begun.fit);
        let mut with = Evaluation::new(&mut *model).until(interrupt);
        with.work = work;
        let ended = begun.finish(problem, recordings, &mut with);
        let work = with.work;
        match ended {
            Ok((fit, method)) => {
                let start = Start::of(problem, &fit);
                Ended { start, fit: Some((model, fit, method)), error: None, work }
            }
            Err(error) => {
                let start = Start { status: Some(FitStatus::NotFinite), ..begin };
                Ended { start, fit: None, error: Some(error), work }
            }
        }
    }

    fn set_aside(self, problem: &Problem) -> Ended<'a> {
        let start = Start { status: None, ..Start::of(problem, &self.begun.fit) };
        Ended { start, fit: None, error: None, work: self.work }
    }
}

/// The place of the lowest cost; of those that ended in the same minimum, the first that converged.
fn best(ends: &[Ended<'_>]) -> Option<usize> {
    let fitted = || ends.iter().enumerate().filter(|(_, of)| of.fit.is_some());
    let lowest = fitted().map(|(_, of)| of.start.cost).fold(f64::INFINITY, f64::min);
    let mut same = fitted().filter(|(_, of)| of.start.cost <= (1.0 + SAME) * lowest);
    let converged = same.clone().find(|(_, of)| of.start.status == Some(FitStatus::Converged));
    converged.or_else(|| same.next()).map(|(place, _)| place)
}

impl Identified {
    /// How many of the starts fitted to the end reached the minimum that was found, and how many of
    /// these starts there are.
    #[must_use]
    pub fn agreeing_starts(&self) -> (usize, usize) {
        let fitted = || self.starts.iter().filter(|start| start.status.is_some());
        let same = fitted().filter(|start| start.cost <= (1.0 + SAME) * self.cost);
        (same.count(), fitted().count())
    }
}

/// What `work` makes of each task, in their order, side by side unless interrupted.
fn side_by_side<T: Send, R: Send>(
    tasks: Vec<T>,
    Starts { threads, interrupt, .. }: Starts<'_>,
    work: impl Fn(T) -> R + Sync,
) -> Result<Vec<R>, IdentifyError> {
    let count = tasks.len();
    let queue = Mutex::new(tasks.into_iter().enumerate());
    let results = Mutex::new(Vec::with_capacity(count));
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, count) {
            scope.spawn(|| {
                // The queue is free again while the task is worked on.
                let next = || queue.lock().expect("no thread panics here").next();
                while let Some((place, task)) = next().filter(|_| !is_set(interrupt)) {
                    let result = work(task);
                    results.lock().expect("no thread panics here").push((place, result));
                }
            });
        }
    });
    if is_set(interrupt) {
        return Err(IdentifyError::Interrupted);
    }
    let mut results = results.into_inner().expect("a panic has ended the scope");
    results.sort_by_key(|(place, _)| *place);
    Ok(results.into_iter().map(|(_, result)| result).collect())
}
