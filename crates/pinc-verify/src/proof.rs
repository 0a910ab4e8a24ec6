//! A proof for a small amount of work, beside the errors of a sample.

use crate::problem::StepError;
use crate::search::{Search, SearchSettings};

/// The work that a [small proof](StepError::small_proof) may take: coefficients of boxes, each times
/// the steps of its flow, and times the hundreds of instructions of the equation.
pub const SMALL_PROOF: u64 = 600_000;

/// So many instructions of an equation count once.
const INSTRUCTIONS: usize = 100;

/// How much larger than the largest error found the bounds of a small proof may be.
const RATIO: f64 = 1.25;

/// Points of the sample in which large errors are looked for, and moves from the worst of them.
const POINTS: usize = 500;
const MOVES: usize = 10;

/// Steps of the flow of a box, at most.
const MOST_STEPS: usize = 16;

impl StepError {
    /// Bounds of each state's error over `domain`, in the states' units, at most 1.25 times the
    /// largest error found; none if that takes more work than [`SMALL_PROOF`].
    ///
    /// Since work is counted, the result is the same on every machine and for every number of
    /// threads.
    #[must_use]
    pub fn small_proof(&self, domain: &[[f64; 2]], threads: usize) -> Option<Vec<f64>> {
        let settings = SearchSettings {
            ratio: RATIO,
            points: POINTS,
            moves: MOVES,
            most_steps: MOST_STEPS,
            ..SearchSettings::default()
        };
        let mut search = Search::new(self, domain, settings, threads).ok()?;
        // Where the equation is not smooth even points may have no enclosure.
        let is_known = search.bracket().found.iter().all(|found| found.error > 0.0);
        let instructions = self.flow.equation.listing().instructions.len();
        let most = SMALL_PROOF / instructions.div_ceil(INSTRUCTIONS).max(1) as u64;
        while is_known && !search.is_over() {
            if search.work_after_a_round(self) > most {
                return None;
            }
            search.round(self, threads);
        }
        let bracket = search.bracket();
        bracket.is_complete.then_some(bracket.proven)
    }
}
