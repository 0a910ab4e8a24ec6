//! The order in which candidates are tried.

use crate::candidate::{Candidate, Shape, shapes};
use crate::judge::{Standard, Tried};
use crate::ladder::{self, Rung};
use pinc_config::ControlSpec;
use pinc_net::TrainingTarget;
use pinc_ode::{Integrator, Scheme};

/// A good model is measured again if its control step took at most this many times as long as the
/// cheapest's: in one measurement, times are wrong by a third.
const REACH: f64 = 2.0;

/// The most models that are measured again.
const FINALISTS: usize = 8;

/// How often they are, in turns, so that a time at which the machine is slow is one for all. Of
/// each the least counts.
const ROUNDS: usize = 15;

/// The place among the [`shapes`] of the first net that is tried.
const FIRST_NET: usize = 1;

/// From so many substeps on, the method for stiff plants may be cheaper.
const STIFF: usize = 8;

/// A larger net is not tried if the last one's control step takes this many times as long as the
/// cheapest good integrator's.
const HOPELESS: f64 = 2.0;

/// The loops that candidates are tried in.
pub trait Loops {
    /// What keeps all candidates from being tried.
    type Error;

    /// The result of a candidate's loop; `None` if there is no time left for it. There always is
    /// for the first round of [measurements](Purpose::Time).
    ///
    /// # Errors
    ///
    /// If no candidate can be tried any more.
    fn run(&mut self, candidate: Candidate, purpose: Purpose)
    -> Result<Option<Tried>, Self::Error>;
}

/// The purpose of running a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Whether the model is good enough.
    Quality,
    /// How long its control step takes.
    Time {
        /// How often the loop is run.
        repetitions: usize,
        /// Which of several measurements it is, from 1.
        round: usize,
    },
}

/// A search for the model of a loop.
#[derive(Clone, Debug)]
pub struct Search<'a> {
    /// The loop.
    pub control: &'a ControlSpec,
    /// The sources that nets are trained on, the best guess first; empty if no nets are tried.
    pub sources: &'a [TrainingTarget],
    /// How many states the plant has.
    pub states: usize,
    /// How much more than the most exact model's an IAE may be, relative.
    pub within: f64,
    /// Whether integrators are tried. A plant without an equation is itself the most exact model.
    pub has_equation: bool,
}

/// The result of a search.
#[derive(Clone, Debug, Default)]
pub struct SearchResult {
    /// All that was tried, in this order.
    pub tried: Vec<Tried>,
    /// Whether something was not tried for want of time.
    pub is_out_of_time: bool,
    /// The models not tried, and why, in words.
    pub untried: Vec<String>,
}

impl SearchResult {
    /// Tries a candidate with its loop run once; gives whether that was done.
    fn attempt<L: Loops>(&mut self, loops: &mut L, candidate: Candidate) -> Result<bool, L::Error> {
        let Some(tried) = loops.run(candidate, Purpose::Quality)? else {
            self.is_out_of_time = true;
            return Ok(false);
        };
        self.tried.push(tried);
        Ok(true)
    }

    /// Adds what `proof` gives for each model that is good.
    pub fn prove(&mut self, standard: &Standard, proof: impl Fn(&Tried) -> Option<f64>) {
        for tried in &mut self.tried {
            let is_good = tried.result.as_ref().is_ok_and(|score| standard.is_good(score));
            let proven = if is_good { proof(tried) } else { None };
            if let Ok(score) = &mut tried.result {
                score.proven = proven;
            }
        }
    }

    fn known(&self, candidate: Candidate) -> Option<&Tried> {
        self.tried.iter().find(|tried| tried.candidate == candidate)
    }
}

impl Search<'_> {
    /// Tries what is worth it.
    ///
    /// # Errors
    ///
    /// Returns an error of `loops`.
    pub fn run<L: Loops>(&self, loops: &mut L) -> Result<SearchResult, L::Error> {
        let mut found = SearchResult::default();
        self.exact(&mut found, loops)?;
        if self.standard(&found.tried).is_some() {
            if self.has_equation {
                self.cheap(&mut found, loops)?;
            }
            self.nets(&mut found, loops)?;
            self.finals(&mut found, loops)?;
        }
        Ok(found)
    }

    /// The standard that models must meet, from the loops tried; `None` if no integrator's loop
    /// stands.
    #[must_use]
    pub fn standard(&self, tried: &[Tried]) -> Option<Standard> {
        Standard::of(tried, self.control, self.within)
    }

    /// What was tried of an integrator, judged by what is the most exact one so far.
    fn rungs(&self, tried: &[Tried], of: Integrator) -> Vec<Rung> {
        let standard = self.standard(tried);
        let rung = |tried: &Tried| match (tried.candidate, &tried.result) {
            (Candidate::Integrator { integrator, substeps }, result) if integrator == of => {
                let score = result.as_ref().ok();
                let stands = score.filter(|score| score.stands(self.control.max_failed_share));
                let good = score.zip(standard.as_ref()).is_some_and(|(s, to)| to.is_good(s));
                Some(Rung { substeps, iae: stands.map(|score| score.iae), good })
            }
            _ => None,
        };
        tried.iter().filter_map(rung).collect()
    }

    /// Tries the substeps that `next` says, until it says none or the time is up.
    fn climb<L: Loops>(
        &self,
        found: &mut SearchResult,
        loops: &mut L,
        integrator: Integrator,
        next: impl Fn(&[Rung]) -> Option<usize>,
    ) -> Result<(), L::Error> {
        while let Some(substeps) = next(&self.rungs(&found.tried, integrator)) {
            if !found.attempt(loops, Candidate::Integrator { integrator, substeps })? {
                break;
            }
        }
        Ok(())
    }

    /// A model that is so exact that a better one changes nothing.
    fn exact<L: Loops>(&self, found: &mut SearchResult, loops: &mut L) -> Result<(), L::Error> {
        let tolerance = 0.1 * self.within;
        if !self.has_equation {
            found.attempt(loops, Candidate::BlackBox)?;
            return Ok(());
        }
        for integrator in [Integrator::Rk4, Integrator::Rosenbrock] {
            let start = self.control.own_substeps(integrator);
            self.climb(found, loops, integrator, |tried| ladder::finer(start, tried, tolerance))?;
            if ladder::is_exact(&self.rungs(&found.tried, integrator), tolerance) {
                break;
            }
        }
        Ok(())
    }

    /// The fewest substeps that are good, of each method.
    fn cheap<L: Loops>(&self, found: &mut SearchResult, loops: &mut L) -> Result<(), L::Error> {
        for integrator in Integrator::ALL {
            let of_rk4 = self.rungs(&found.tried, Integrator::Rk4);
            let fewest = of_rk4.iter().filter(|rung| rung.good).map(|rung| rung.substeps).min();
            if integrator.scheme() == Scheme::LinearlyImplicit
                && let Some(fewest) = fewest.filter(|fewest| *fewest < STIFF)
            {
                found.untried.push(format!(
                    "{}: RK4 is good with {fewest} substeps, fewer than {STIFF}",
                    integrator.title()
                ));
                continue;
            }
            let start = self.control.own_substeps(integrator);
            self.climb(found, loops, integrator, |tried| ladder::fewer(start, tried))?;
        }
        Ok(())
    }

    /// Nets from the first guess to the smallest that is good, of each source.
    fn nets<L: Loops>(&self, found: &mut SearchResult, loops: &mut L) -> Result<(), L::Error> {
        let Some(standard) = &self.standard(&found.tried) else { return Ok(()) };
        let cheapest = standard.ranking(&found.tried).first().map(|(_, score)| score.p50_us);
        let hopeless = cheapest.map_or(f64::INFINITY, |cheapest| HOPELESS * cheapest);
        let shapes = shapes(self.states);
        let mut start = FIRST_NET;
        for (i, &source) in self.sources.iter().enumerate() {
            let places = |found: &SearchResult| places(shapes, &found.tried, standard, source);
            while let Some(place) = ladder::size(start, shapes.len(), &places(found)) {
                if place > 0
                    && let Some(us) = self.out_of_reach(found, shapes[place - 1], source, hopeless)
                {
                    found.untried.push(format!(
                        "{}: the control step with {} takes {us:.1} us, more than {HOPELESS} times that \
                         of the cheapest good {}",
                        names(&shapes[place..], source),
                        Candidate::Net { shape: shapes[place - 1], source, longer: false },
                        standard.exact.noun(),
                    ));
                    break;
                }
                if !try_net(found, loops, standard, (shapes[place], source))? {
                    self.note_time(found, &self.sources[i..]);
                    return Ok(());
                }
            }
            found.untried.extend(not_needed(shapes, &places(found), source));
            let good = places(found).into_iter().filter(|(_, good)| *good).map(|(place, _)| place);
            start = good.min().unwrap_or(FIRST_NET);
        }
        Ok(())
    }

    /// The time of a control step with a net of this size, if it was tried and is out of reach. That
    /// of a loop that fails says nothing: it is spent on problems without a solution.
    fn out_of_reach(
        &self,
        found: &SearchResult,
        shape: Shape,
        source: TrainingTarget,
        hopeless: f64,
    ) -> Option<f64> {
        let smaller = found.known(Candidate::Net { shape, source, longer: false });
        let score = smaller?.result.as_ref().ok()?;
        let stands = score.stands(self.control.max_failed_share);
        (stands && score.p50_us > hopeless).then_some(score.p50_us)
    }

    /// Notes the sizes of nets of `sources` for which there was no time.
    fn note_time(&self, found: &mut SearchResult, sources: &[TrainingTarget]) {
        let shapes = shapes(self.states);
        let is_missing = |source: TrainingTarget| {
            let tried = |shape: Shape| {
                let alike = |of: &Tried| match of.candidate {
                    Candidate::Net { shape: other, source: on, .. } => {
                        other == shape && on == source
                    }
                    Candidate::Integrator { .. } | Candidate::BlackBox => false,
                };
                found.tried.iter().any(alike)
            };
            let missing: Vec<Shape> = shapes.iter().copied().filter(|of| !tried(*of)).collect();
            (!missing.is_empty()).then(|| names(&missing, source))
        };
        let missing: Vec<String> = sources.iter().filter_map(|of| is_missing(*of)).collect();
        if !missing.is_empty() {
            found.untried.push(format!("{}: the time was up", missing.join(", ")));
        }
    }

    /// Measures the times of the best in turns, and keeps the least of each.
    fn finals<L: Loops>(&self, found: &mut SearchResult, loops: &mut L) -> Result<(), L::Error> {
        let Some(standard) = self.standard(&found.tried) else { return Ok(()) };
        let finalists = self.finalists(&standard, &found.tried);
        let wanted = self.control.repetitions.div_ceil(ROUNDS);
        let mut measured: Vec<Option<Tried>> = vec![None; finalists.len()];
        'rounds: for round in 1..=ROUNDS {
            for (&place, least) in finalists.iter().zip(&mut measured) {
                let Tried { candidate, result, .. } = &found.tried[place];
                let repetitions = result.as_ref().map_or(wanted, |score| score.repetitions(wanted));
                let purpose = Purpose::Time { repetitions, round };
                let Some(again) = loops.run(*candidate, purpose)? else { break 'rounds };
                if least.as_ref().is_none_or(|least| faster(&again, least)) {
                    *least = Some(again);
                }
            }
        }
        for (place, least) in finalists.into_iter().zip(measured) {
            if let Some(least) = least {
                found.tried[place] = least;
            }
        }
        Ok(())
    }

    /// The places of the models that are worth another measurement.
    fn finalists(&self, standard: &Standard, tried: &[Tried]) -> Vec<usize> {
        let ranking = standard.ranking(tried);
        let reach = ranking.first().map_or(0.0, |(_, score)| REACH * score.p50_us);
        let near = ranking.iter().filter(|(_, score)| score.p50_us <= reach).take(FINALISTS);
        let place = |candidate| tried.iter().position(|tried| tried.candidate == candidate);
        near.filter_map(|(tried, _)| place(tried.candidate)).collect()
    }
}

/// Nets by their names.
fn names(shapes: &[Shape], source: TrainingTarget) -> String {
    let name = |&shape: &Shape| Candidate::Net { shape, source, longer: false }.to_string();
    shapes.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// What sizes of a source need not be tried, since a smaller one is good, or a larger one is not.
fn not_needed(shapes: &[Shape], tried: &[(usize, bool)], source: TrainingTarget) -> Option<String> {
    let smallest = tried.iter().filter(|(_, good)| *good).map(|(place, _)| *place).min()?;
    let missing = |place: &usize| tried.iter().all(|(other, _)| other != place);
    let larger: Vec<Shape> =
        (smallest + 1..shapes.len()).filter(missing).map(|place| shapes[place]).collect();
    let smaller: Vec<Shape> = (0..smallest).filter(missing).map(|place| shapes[place]).collect();
    let good = Candidate::Net { shape: shapes[smallest], source, longer: false };
    let mut parts = Vec::new();
    if !larger.is_empty() {
        parts.push(format!("{}: {good} is good and smaller", names(&larger, source)));
    }
    if !smaller.is_empty() {
        parts.push(format!("{}: larger ones were not good", names(&smaller, source)));
    }
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// Tries a net, and once more with a longer training if it was nearly good; gives whether there
/// was time for it.
fn try_net<L: Loops>(
    found: &mut SearchResult,
    loops: &mut L,
    standard: &Standard,
    (shape, source): (Shape, TrainingTarget),
) -> Result<bool, L::Error> {
    let net = |longer| Candidate::Net { shape, source, longer };
    if !found.attempt(loops, net(false))? {
        return Ok(false);
    }
    let score = found.known(net(false)).and_then(|tried| tried.result.as_ref().ok());
    if score.is_some_and(|score| standard.is_nearly_good(score)) {
        return found.attempt(loops, net(true));
    }
    Ok(true)
}

/// Whether a loop's control step was shorter than in another measurement.
fn faster(a: &Tried, b: &Tried) -> bool {
    let time = |tried: &Tried| tried.result.as_ref().map_or(f64::INFINITY, |score| score.p50_us);
    time(a) < time(b)
}

/// The nets of a source that were tried, as places in `shapes`, and whether they are good.
fn places(
    shapes: &[Shape],
    tried: &[Tried],
    standard: &Standard,
    source: TrainingTarget,
) -> Vec<(usize, bool)> {
    let place = |(place, &shape): (usize, &Shape)| {
        let trainings = [false, true].map(|longer| Candidate::Net { shape, source, longer });
        let mut nets = tried.iter().filter(|tried| trainings.contains(&tried.candidate)).peekable();
        nets.peek()?;
        let is_good = |net: &Tried| net.result.as_ref().is_ok_and(|score| standard.is_good(score));
        Some((place, nets.any(is_good)))
    };
    shapes.iter().enumerate().filter_map(place).collect()
}

#[cfg(test)]
mod tests;

#[cfg(test)]
pub(crate) use tests::SPEC;
