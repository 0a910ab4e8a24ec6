//! The largest error of a step over a whole box, from both sides.

use crate::branching::PartSearch;
use crate::error::VerifyError;
use crate::parts::{Part, Places};
use crate::points::{EFFORT, Largest};
use crate::problem::StepError;
use serde::{Deserialize, Serialize};

/// How a domain is searched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SearchSettings {
    /// How much larger than the largest error found the proven bound may be: the search ends once
    /// it is below this ratio for every state.
    pub ratio: f64,
    /// A bound that is to be proven for each state instead, in its unit; infinite where any will do.
    pub tolerance: Option<Vec<f64>>,
    /// Total degree of the polynomials; none for a choice by the number of variables.
    pub degree: Option<usize>,
    /// Points of the sample in which large errors are looked for first.
    pub points: usize,
    /// Moves of each search for a larger error from a point, at most.
    pub moves: usize,
    /// Steps of the flow of a box, at most; a power of 2.
    pub most_steps: usize,
    /// Where the sample begins.
    pub seed: u64,
}

impl Default for SearchSettings {
    fn default() -> Self {
        Self {
            ratio: 1.1,
            tolerance: None,
            degree: None,
            points: 2000,
            moves: EFFORT.0,
            most_steps: EFFORT.1,
            seed: 1,
        }
    }
}

/// A box of the domain, and what is proven in it of the states of one part.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaf {
    /// The ends of all states, inputs and parameters.
    pub ends: Vec<[f64; 2]>,
    /// States, and a proven bound of the error of each; none where nothing is known.
    pub bounds: Vec<(usize, Option<f64>)>,
}

/// What is known of the errors of one step over a domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Bracket {
    /// The largest error found of each state.
    pub found: Vec<Largest>,
    /// Proven bounds of the errors of each state, wherever there are any.
    pub proven: Vec<f64>,
    /// The share of the domain in which nothing is proven of some state, at most.
    pub unproven_volume: f64,
    /// Whether the bounds are within the ratio asked for, everywhere.
    pub is_complete: bool,
    /// Parts that the domain is cut into.
    pub leaves: usize,
    /// Parts whose bounds are within the ratio.
    pub settled: usize,
    /// Boxes that were enclosed.
    pub boxes: u64,
}

/// A search in progress: it can be stopped after any round, stored and taken up again.
///
/// States that do not depend on all variables are searched apart, over the variables that they depend
/// on. A round encloses the same boxes whatever the number of threads, so that the result depends on
/// the number of rounds alone.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Search {
    domain: Vec<[f64; 2]>,
    parts: Vec<(Places, PartSearch)>,
}

impl Search {
    /// Looks for large errors in a sample of the domain, `[low, high]` of each state, input and
    /// parameter, and encloses the whole domain once.
    ///
    /// # Errors
    ///
    /// [`VerifyError::TooManyVariables`] if a state depends on more than can be searched, or
    /// [`VerifyError::Domain`] if there is not one range per variable.
    pub fn new(
        error: &StepError,
        domain: &[[f64; 2]],
        settings: SearchSettings,
        threads: usize,
    ) -> Result<Self, VerifyError> {
        let variables = error.variables();
        if domain.len() != variables {
            return Err(VerifyError::Domain { found: domain.len(), expected: variables });
        }
        let search = |part: Part| {
            let ends = part.places.pick(domain);
            let tolerance = settings.tolerance.as_ref();
            let tolerance = tolerance.map(|all| part.places.pick_states(all));
            let settings = SearchSettings { tolerance, ..settings.clone() };
            let search = PartSearch::new(&part, ends, settings, threads)?;
            Ok((part.places, search))
        };
        let parts = error.parts().into_iter().map(search).collect::<Result<_, _>>()?;
        Ok(Self { domain: domain.to_vec(), parts })
    }

    /// Whether every bound is within the ratio of what was found, or cannot get any better.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.parts.iter().all(|(_, part)| part.is_over())
    }

    /// Whether an error was found that is beyond its tolerance: then no proof is possible.
    #[must_use]
    pub fn is_refuted(&self) -> bool {
        self.parts.iter().any(|(_, part)| part.is_refuted())
    }

    /// The work that is done, and about what one more round adds: the coefficients of boxes, each
    /// times the steps of its flow.
    pub(crate) fn work_after_a_round(&self, error: &StepError) -> u64 {
        let parts = self.parts.iter().zip(error.parts());
        parts.map(|((_, search), part)| search.work_after_a_round(&part.error)).sum()
    }

    /// Cuts the worst leaves.
    ///
    /// # Panics
    ///
    /// If `error` has other variables than the domain.
    pub fn round(&mut self, error: &StepError, threads: usize) {
        for ((_, search), part) in self.parts.iter_mut().zip(error.parts()) {
            if !search.is_over() {
                search.round(&part.error, threads);
            }
        }
    }

    /// The leaves. For each state, the boxes of those that bound it make up the domain.
    pub fn leaves(&self) -> impl Iterator<Item = Leaf> {
        self.parts.iter().flat_map(|(places, search)| {
            search.leaves().map(|leaf| {
                let mut ends = self.domain.clone();
                places.put(&leaf.ends, &mut ends);
                let bound = |(state, at): (usize, usize)| (state, leaf.bound[at]);
                Leaf { ends, bounds: places.states().map(bound).collect() }
            })
        })
    }

    /// What is known so far.
    #[must_use]
    pub fn bracket(&self) -> Bracket {
        let middle: Vec<f64> =
            self.domain.iter().map(|[low, high]| 0.5 * low + 0.5 * high).collect();
        let parts: Vec<(&Places, Bracket)> =
            self.parts.iter().map(|(places, search)| (places, search.bracket())).collect();
        let mut states: Vec<(usize, Largest, f64)> = Vec::new();
        for (places, part) in &parts {
            states.extend(places.states().map(|(state, at)| {
                let mut found = Largest { at: middle.clone(), ..part.found[at] };
                places.put(&part.found[at].at, &mut found.at);
                (state, found, part.proven[at])
            }));
        }
        states.sort_by_key(|(state, _, _)| *state);
        let sum = |of: fn(&Bracket) -> usize| parts.iter().map(|(_, part)| of(part)).sum();
        let unproven: f64 = parts.iter().map(|(_, part)| part.unproven_volume).sum();
        Bracket {
            proven: states.iter().map(|(_, _, proven)| *proven).collect(),
            found: states.into_iter().map(|(_, found, _)| found).collect(),
            unproven_volume: unproven.min(1.0),
            is_complete: parts.iter().all(|(_, part)| part.is_complete),
            leaves: sum(|part| part.leaves),
            settled: sum(|part| part.settled),
            boxes: parts.iter().map(|(_, part)| part.boxes).sum(),
        }
    }
}
