//! Branch and bound of one part of a step over its box.

use crate::error::VerifyError;
use crate::parts::Part;
use crate::points::{Largest, spread};
use crate::problem::{BoxError, Enclosing, MOST_VARIABLES, StepError, TOGETHER};
use crate::rounding::up;
use crate::search::{Bracket, SearchSettings};
use crate::workers::in_parallel;
use serde::{Deserialize, Serialize};

/// A box of the domain of a part.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PartLeaf {
    /// The ends of the part's variables.
    pub(crate) ends: Vec<[f64; 2]>,
    /// A proven bound of the error of each of its states; none where nothing is known.
    pub(crate) bound: Vec<Option<f64>>,
    /// The variable in which it is cut next.
    cut: usize,
    /// Steps of the flow.
    steps: usize,
    /// What the flow's polynomial misses, for the state that is furthest from its goal.
    flow: Option<f64>,
    /// Cuts from the whole domain.
    depth: usize,
}

/// The search of one part.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PartSearch {
    settings: SearchSettings,
    /// Which of its states are judged.
    judged: Vec<bool>,
    domain: Vec<[f64; 2]>,
    found: Vec<Largest>,
    /// Leaves that are not good enough yet.
    open: Vec<PartLeaf>,
    /// Leaves that are.
    closed: Vec<PartLeaf>,
    boxes: u64,
    /// Coefficients of all boxes, each times the steps of its flow.
    work: u64,
}

/// Leaves that are cut in a round, at most.
const ROUND: usize = 512;

/// Cuts after which a leaf of which nothing is known is left alone.
const DEEPEST: usize = 60;

/// The part of a goal that what is missing in the flow of a point may take.
const FLOW_SHARE: f64 = 2e-2;

/// Errors below this part of a state's range are rounding.
const NEGLIGIBLE: f64 = 1e-11;

impl PartSearch {
    /// Looks for large errors in a sample of the domain, and encloses the whole domain once.
    pub(crate) fn new(
        part: &Part,
        domain: Vec<[f64; 2]>,
        settings: SearchSettings,
        threads: usize,
    ) -> Result<Self, VerifyError> {
        let (error, variables) = (&part.error, domain.len());
        if variables > MOST_VARIABLES {
            return Err(VerifyError::TooManyVariables { found: variables });
        }
        let domain = &domain[..];
        let judged = part.places.judged();
        let points = spread(domain, settings.points, settings.seed);
        let effort = (settings.moves, settings.most_steps);
        let found = error.largest(domain, &points, &judged, effort, threads);
        let mut search = Self {
            settings,
            judged,
            domain: domain.to_vec(),
            found,
            open: Vec::new(),
            closed: Vec::new(),
            boxes: 0,
            work: 0,
        };
        let allowed: Vec<f64> = search.goals().iter().map(|goal| FLOW_SHARE * goal).collect();
        // The last ones are corners.
        let hard: Vec<Vec<f64>> = points.into_iter().rev().take(160).collect();
        let most = search.settings.most_steps;
        let steps = error.steps_for((search.order(), most), &hard, &allowed, threads);
        let whole = PartLeaf {
            ends: domain.to_vec(),
            bound: vec![None; error.states()],
            cut: 0,
            steps,
            flow: None,
            depth: 0,
        };
        search.enclose(error, vec![whole], threads);
        Ok(search)
    }

    /// The degree of the polynomials.
    fn degree(&self) -> usize {
        self.settings.degree.unwrap_or(match self.domain.len() {
            0..=2 => 8,
            3 => 6,
            4 => 5,
            _ => 4,
        })
    }

    /// Powers of the time.
    fn order(&self) -> usize {
        self.degree() + 2
    }

    /// What each state's bound has to come down to; infinite for those that are not judged.
    fn goals(&self) -> Vec<f64> {
        let goal = |state: usize| match &self.settings.tolerance {
            _ if !self.judged[state] => f64::INFINITY,
            Some(tolerance) => tolerance[state],
            None => {
                let [low, high] = self.domain[state];
                (self.settings.ratio * self.found[state].error).max(NEGLIGIBLE * (high - low))
            }
        };
        (0..self.judged.len()).map(goal).collect()
    }

    /// Whether every bound is within the ratio of what was found, or cannot get any better.
    pub(crate) fn is_over(&self) -> bool {
        self.open.iter().all(|leaf| leaf.depth >= DEEPEST)
    }

    /// Whether an error was found that is beyond its tolerance: then no proof is possible.
    pub(crate) fn is_refuted(&self) -> bool {
        let tolerance = self.settings.tolerance.iter().flatten();
        self.found.iter().zip(tolerance).any(|(found, tolerance)| found.error > *tolerance)
    }

    /// The work that is done, and about what one more round adds: the coefficients of boxes, each
    /// times the steps of its flow.
    pub(crate) fn work_after_a_round(&self, error: &StepError) -> u64 {
        let halves = self.open.iter().take(ROUND).map(|leaf| 2 * leaf.steps as u64);
        let over = error.enclosing(self.degree(), self.order());
        self.work + over.coefficients() as u64 * halves.sum::<u64>()
    }

    /// Cuts the worst leaves.
    pub(crate) fn round(&mut self, error: &StepError, threads: usize) {
        let goals = self.goals();
        let (close, mut open) = std::mem::take(&mut self.open)
            .into_iter()
            .partition(|leaf| excess(leaf, &goals) <= 1.0);
        let mut close: Vec<PartLeaf> = close;
        self.closed.append(&mut close);
        // Where nothing is known the largest come first; elsewhere those furthest from the goal.
        let unknown = |leaf: &PartLeaf| excess(leaf, &goals).is_infinite();
        let order =
            |leaf: &PartLeaf| if unknown(leaf) { volume(leaf) } else { excess(leaf, &goals) };
        open.sort_by(|a: &PartLeaf, b: &PartLeaf| order(b).total_cmp(&order(a)));
        let most = [ROUND / 2, ROUND - ROUND / 2];
        let mut taken = [0, 0];
        let (cut, left): (Vec<PartLeaf>, Vec<PartLeaf>) = open.into_iter().partition(|leaf| {
            let kind = usize::from(unknown(leaf));
            let take = leaf.depth < DEEPEST && taken[kind] < most[kind];
            taken[kind] += usize::from(take);
            take
        });
        self.open = left;
        let halves = cut.iter().flat_map(PartLeaf::halves).collect();
        self.enclose(error, halves, threads);
    }

    /// Encloses leaves with what is known of their parents and puts them where they belong.
    fn enclose(&mut self, error: &StepError, mut leaves: Vec<PartLeaf>, threads: usize) {
        let over = error.enclosing(self.degree(), self.order());
        let goals = self.goals();
        leaves.sort_by_key(|leaf| leaf.steps);
        let batches: Vec<&[PartLeaf]> = leaves
            .chunk_by(|a, b| a.steps == b.steps)
            .flat_map(|same| same.chunks(TOGETHER))
            .collect();
        let judged = in_parallel(&batches, threads, |batch| {
            let boxes: Vec<&[[f64; 2]]> = batch.iter().map(|leaf| &leaf.ends[..]).collect();
            let found = error.enclose(&over, &boxes, batch[0].steps);
            let pairs = batch.iter().zip(&found);
            let most = self.settings.most_steps;
            pairs.map(|(leaf, found)| judge((&over, most), leaf, found, &goals)).collect::<Vec<_>>()
        });
        self.boxes += leaves.len() as u64;
        let steps = leaves.iter().map(|leaf| leaf.steps as u64).sum::<u64>();
        self.work += over.coefficients() as u64 * steps;
        let judged: Vec<(PartLeaf, Vec<f64>)> = judged.into_iter().flatten().collect();
        self.look_at(error, &judged);
        let goals = self.goals();
        for (leaf, _) in judged {
            let good = excess(&leaf, &goals) <= 1.0;
            if good { &mut self.closed } else { &mut self.open }.push(leaf);
        }
    }

    /// Searches from the middles of leaves in which an error is larger than the largest found.
    fn look_at(&mut self, error: &StepError, judged: &[(PartLeaf, Vec<f64>)]) {
        for state in (0..error.states()).filter(|state| self.judged[*state]) {
            let largest = judged.iter().max_by(|a, b| a.1[state].total_cmp(&b.1[state]));
            let Some((leaf, least)) = largest else { return };
            if least[state] > self.found[state].error * (1.0 + 1e-6) {
                let at: Vec<f64> =
                    leaf.ends.iter().map(|[low, high]| 0.5 * low + 0.5 * high).collect();
                let effort = (self.settings.moves, self.settings.most_steps);
                let found = error.climb(&self.domain, &at, state, effort);
                if found.error > self.found[state].error {
                    self.found[state] = found;
                }
            }
        }
    }

    /// The leaves, whose boxes make up the domain.
    pub(crate) fn leaves(&self) -> impl Iterator<Item = &PartLeaf> {
        self.open.iter().chain(&self.closed)
    }

    /// What is known so far of the part's states.
    pub(crate) fn bracket(&self) -> Bracket {
        let goals = self.goals();
        let mut proven = vec![0.0_f64; goals.len()];
        let (mut unproven, mut leaves, mut settled) = (0.0, 0, 0);
        for leaf in self.leaves() {
            leaves += 1;
            settled += usize::from(excess(leaf, &goals) <= 1.0);
            let known: Option<Vec<f64>> = leaf.bound.iter().copied().collect();
            match known {
                Some(known) => {
                    proven.iter_mut().zip(known).for_each(|(most, bound)| *most = most.max(bound));
                }
                None => unproven += volume(leaf),
            }
        }
        let whole: f64 = self.domain.iter().map(|[low, high]| high - low).product();
        Bracket {
            found: self.found.clone(),
            proven,
            unproven_volume: unproven / whole,
            is_complete: settled == leaves,
            leaves,
            settled,
            boxes: self.boxes,
        }
    }
}

impl PartLeaf {
    /// Its two halves, with what is known of it.
    fn halves(&self) -> [Self; 2] {
        let [low, high] = self.ends[self.cut];
        let middle = 0.5 * low + 0.5 * high;
        [[low, middle], [middle, high]].map(|ends| {
            let mut half = self.clone();
            half.ends[self.cut] = ends;
            half.depth += 1;
            half
        })
    }

    /// Where nothing is known: the states one after the other, and now and then the rest.
    fn next_in_turn(&self, states: usize) -> usize {
        let rest = self.ends.len() - states;
        match self.depth % (3 * states + rest) {
            turn if turn < 3 * states => turn % states,
            turn => turn - 2 * states,
        }
    }
}

fn volume(leaf: &PartLeaf) -> f64 {
    leaf.ends.iter().map(|[low, high]| high - low).product()
}

/// The ratio of a bound to its goal; infinite where nothing is known of what has a goal.
fn ratio(bound: Option<f64>, goal: f64) -> f64 {
    match bound {
        _ if goal.is_infinite() => 0.0,
        Some(bound) => bound / goal,
        None => f64::INFINITY,
    }
}

/// The largest ratio of a bound to its goal.
fn excess(leaf: &PartLeaf, goals: &[f64]) -> f64 {
    let ratios = leaf.bound.iter().zip(goals).map(|(bound, goal)| ratio(*bound, *goal));
    ratios.fold(0.0, f64::max)
}

/// The leaf with the bounds that follow from its enclosure, and what each state's error is in it at
/// least.
fn judge(
    (over, most_steps): (&Enclosing, usize),
    leaf: &PartLeaf,
    found: &BoxError,
    goals: &[f64],
) -> (PartLeaf, Vec<f64>) {
    let mut judged = leaf.clone();
    let mut least = vec![0.0; goals.len()];
    for (state, goal) in goals.iter().enumerate() {
        let missing = found.of_map[state] + found.of_flow[state];
        if !missing.is_finite() {
            continue;
        }
        let bounds = over.cuts.bound(&found.polynomials[state], goal - missing);
        let bound = up(bounds.most + missing);
        if bound.is_finite() {
            let before = leaf.bound[state].unwrap_or(f64::INFINITY);
            judged.bound[state] = Some(bound.min(before));
            least[state] = (bounds.least - missing).max(0.0);
        }
    }
    plan((over, most_steps), &mut judged, found, goals);
    (judged, least)
}

/// Decides how a leaf is cut, should it be: in the variable that drives what keeps the worst state
/// from its goal. Where that is the flow's remainder and a cut did not help, it needs more steps.
fn plan(
    (over, most_steps): (&Enclosing, usize),
    leaf: &mut PartLeaf,
    found: &BoxError,
    goals: &[f64],
) {
    let ratio = |i: usize| ratio(leaf.bound[i], goals[i]);
    let worst = (0..goals.len()).max_by(|a, b| ratio(*a).total_cmp(&ratio(*b))).unwrap_or(0);
    let (map, flow) = (found.of_map[worst], found.of_flow[worst]);
    let limits = flow > map && flow > 0.3 * goals[worst];
    if limits && leaf.steps < most_steps && leaf.flow.is_some_and(|before| flow > before / 1.5) {
        leaf.steps *= 2;
        leaf.flow = None;
    } else {
        leaf.flow = flow.is_finite().then_some(flow);
    }
    let changes = match map + flow {
        missing if missing <= 0.3 * goals[worst] => {
            over.cuts.changes(&found.polynomials[worst].coefficients, 1)
        }
        _ if flow > map => found.drives[1].clone(),
        _ => found.drives[0].clone(),
    };
    let most = (0..changes.len()).max_by(|a, b| changes[*a].total_cmp(&changes[*b]));
    let known = changes.iter().all(|change| change.is_finite()) && ratio(worst).is_finite();
    let useful = known && changes.iter().any(|change| *change > 0.0);
    let most = most.filter(|_| useful).or(found.obstacle);
    leaf.cut = most.unwrap_or_else(|| leaf.next_in_turn(goals.len()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StepModel;
    use crate::polynomial::Polynomial;
    use crate::tests::{Numbers, exact};
    use pinc_expr::PlantEquations;
    use pinc_ode::Tableau;
    use pinc_plants::OneTank;

    /// The bound of a leaf holds what model and flow miss, and so does what it is at least.
    #[test]
    fn a_leaf_misses_what_model_and_flow_miss() {
        let model = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
        let tank = PlantEquations::traced(OneTank::default());
        let error = StepError::new(&tank, &[], 1, model, 1.0).unwrap();
        let over = error.enclosing(2, 2);
        let mut coefficients = vec![0.0; over.coefficients()];
        coefficients[0] = 0.5;
        let found = BoxError {
            polynomials: vec![Polynomial { coefficients, rounding: 0.0 }],
            of_map: vec![0.25],
            of_flow: vec![0.125],
            drives: [vec![0.0; 2], vec![0.0; 2]],
            obstacle: None,
        };
        let leaf = PartLeaf {
            ends: vec![[1.0, 2.0], [0.0, 1.0]],
            bound: vec![None],
            cut: 0,
            steps: 1,
            flow: None,
            depth: 0,
        };
        let (judged, least) = judge((&over, 8), &leaf, &found, &[1.0]);
        let bound = judged.bound[0].unwrap();
        assert!((bound - 0.875).abs() < 1e-8 && bound >= 0.875, "{bound}");
        assert!((least[0] - 0.125).abs() < 1e-8, "{least:?}");
        // What is missing is all of the bound where the polynomial is 0.
        let mut numbers = Numbers::new();
        for _ in 0..100 {
            let [map, flow] = [3.0, 7.0].map(|part| numbers.share() / part);
            let mut found = found.clone();
            found.polynomials[0].coefficients[0] = 0.0;
            (found.of_map[0], found.of_flow[0]) = (map, flow);
            let (judged, _) = judge((&over, 8), &leaf, &found, &[10.0]);
            assert!(exact(judged.bound[0].unwrap()) >= exact(map) + exact(flow));
        }
    }
}
