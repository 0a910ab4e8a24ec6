//! What is known of the trials that are over.

use pinc_config::Trial;
use pinc_record::{Ending, Finished, RecordError, SweepDir, SweepMetrics};
use std::collections::HashMap;

/// The results of the trials of a sweep, as far as they are over.
#[derive(Debug)]
pub(super) struct Ledger<'a> {
    /// The places of the trials by their hashes: those of a sweep may be equal.
    places: HashMap<&'a str, Vec<usize>>,
    results: Vec<Option<Finished>>,
}

impl<'a> Ledger<'a> {
    /// Nothing is known yet.
    pub(super) fn new(trials: &'a [Trial]) -> Self {
        let mut places: HashMap<&str, Vec<usize>> = HashMap::new();
        for (i, trial) in trials.iter().enumerate() {
            places.entry(&trial.id).or_default().push(i);
        }
        Self { places, results: vec![None; trials.len()] }
    }

    /// Takes up what is in `dir` and was not known.
    pub(super) fn look_up(&mut self, dir: &SweepDir) -> Result<(), RecordError> {
        let Self { places, results } = self;
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
    pub(super) fn note(&mut self, trial: &Trial, finished: &Finished) {
        for &place in self.places.get(trial.id.as_str()).into_iter().flatten() {
            self.results[place] = Some(finished.clone());
        }
    }

    pub(super) fn knows(&self, trial: &Trial) -> bool {
        let place = self.places.get(trial.id.as_str()).map(|places| places[0]);
        place.is_some_and(|place| self.results[place].is_some())
    }

    /// The results, in the order of the trials.
    pub(super) fn results(&self) -> &[Option<Finished>] {
        &self.results
    }

    pub(super) fn counts(&self) -> SweepMetrics {
        let over = self.results.iter().flatten();
        let failed = over.clone().filter(|finished| finished.ending != Ending::Done).count();
        SweepMetrics { trials: self.results.len(), done: over.count() - failed, failed }
    }
}
