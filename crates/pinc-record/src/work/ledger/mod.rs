//! The ledger of finished trials.

use crate::ViolationMetrics;
use crate::error::RecordError;
use crate::metrics::{BrokenBounds, SweepMetrics};
use crate::search::{Best, Eligibility, Search};
use crate::sweep_dir::{Ending, Finished, SweepDir};
use pinc_config::{Experiment, ModelKind, Trial};
use std::collections::HashMap;

/// The results of the trials of a sweep, as far as they are over.
#[derive(Debug)]
pub struct Ledger<'a> {
    /// The places of the trials by their hashes, which may be equal within a sweep.
    places: HashMap<&'a str, Vec<usize>>,
    results: Vec<Option<Finished>>,
    search: Option<Search<'a>>,
}

impl<'a> Ledger<'a> {
    /// Nothing is known yet.
    #[must_use]
    pub fn new(experiment: &'a Experiment, trials: &'a [Trial]) -> Self {
        let mut places: HashMap<&str, Vec<usize>> = HashMap::new();
        for (i, trial) in trials.iter().enumerate() {
            places.entry(&trial.id).or_default().push(i);
        }
        let search = Search::of(experiment, trials);
        Self { places, results: vec![None; trials.len()], search }
    }

    /// Takes up what is in `dir` and was not known.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read.
    pub fn look_up(&mut self, dir: &SweepDir) -> Result<(), RecordError> {
        let Self { places, results, .. } = self;
        for (id, places) in places {
            if results[places[0]].is_some() {
                continue;
            }
            let Some(finished) = dir.finished(id)? else { continue };
            for &place in &*places {
                results[place] = Some(finished.clone());
            }
        }
        Ok(())
    }

    /// Notes that a trial is over.
    pub fn note(&mut self, trial: &Trial, finished: &Finished) {
        for &place in self.places.get(trial.id.as_str()).into_iter().flatten() {
            self.results[place] = Some(finished.clone());
        }
    }

    /// Whether a trial is known to be over.
    #[must_use]
    pub fn knows(&self, trial: &Trial) -> bool {
        let place = self.places.get(trial.id.as_str()).map(|places| places[0]);
        place.is_some_and(|place| self.results[place].is_some())
    }

    /// The results, in the order of the trials.
    #[must_use]
    pub fn results(&self) -> &[Option<Finished>] {
        &self.results
    }

    /// How the trials stand.
    #[must_use]
    pub fn eligibility(&self) -> Vec<Eligibility> {
        match &self.search {
            Some(search) => search.eligibility(&self.results),
            None => vec![Eligibility::Open; self.results.len()],
        }
    }

    /// How the trials stand, by their hashes: of equal ones one is enough.
    #[must_use]
    pub fn eligibility_by_id(&self) -> HashMap<&'a str, Eligibility> {
        let eligibility = self.eligibility();
        let least = |places: &Vec<usize>| places.iter().map(|&i| eligibility[i]).min();
        let known = self.places.iter().map(|(id, places)| (*id, least(places)));
        known.filter_map(|(id, eligibility)| Some((id, eligibility?))).collect()
    }

    /// The best candidate of a search.
    #[must_use]
    pub fn best(&self) -> Option<Best> {
        self.search.as_ref()?.best(&self.results)
    }

    /// How many trials there are of each kind.
    #[must_use]
    pub fn counts(&self) -> SweepMetrics {
        let over = self.results.iter().flatten();
        let failed = over.clone().filter(|finished| finished.ending != Ending::Done).count();
        let eligibility = self.eligibility();
        let pairs = self.results.iter().zip(&eligibility);
        let dropped = pairs.filter(|(result, eligibility)| {
            result.is_none() && **eligibility == Eligibility::Dropped
        });
        SweepMetrics {
            trials: self.results.len(),
            done: over.count() - failed,
            failed,
            dropped: dropped.count(),
            broken_bounds: self.broken_bounds(),
            best: None,
        }
    }

    fn broken_bounds(&self) -> Vec<BrokenBounds> {
        let done = self.results.iter().flatten().filter(|of| of.ending == Ending::Done);
        let loops = done.flat_map(|of| &of.metrics.control);
        let broken = loops.filter(|of| of.violations.iter().any(ViolationMetrics::is_visible));
        let models: Vec<ModelKind> = broken.map(|of| of.model).collect();
        let of = |model: ModelKind| BrokenBounds {
            model,
            trials: models.iter().filter(|of| **of == model).count(),
        };
        ModelKind::ALL.map(of).into_iter().filter(|of| of.trials > 0).collect()
    }
}

#[cfg(test)]
mod tests;
