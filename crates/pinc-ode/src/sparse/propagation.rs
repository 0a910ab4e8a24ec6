//! The sensitivities of a Runge-Kutta method: K = J S of each stage, with sparse J, and with S
//! where it is not zero.

use super::SparsityPattern;
use super::tableau::Combination;
use pinc_ad::simd::{Simd, Work};
use std::ops::Range;

/// Numbers of columns that go through the method together.
const WIDTHS: [usize; 5] = [2, 3, 4, 6, 8];

/// Derivatives of the state by the variables (x, u, p) at the start of a step, some columns, a
/// *block*, at a time.
///
/// Per block there is a row of [`Sensitivities::width`] columns for each variable: those of inputs
/// and parameters do not change. The blocks are followed by two of the same size for stages.
#[derive(Clone, Debug)]
pub(super) struct Sensitivities<V> {
    width: usize,
    variables: usize,
    states: usize,
    blocks: usize,
    numbers: Vec<V>,
    /// Slopes: for each stage a row for each state.
    slopes: Vec<V>,
    /// Of each substep, until nothing changes any more, and each block.
    reach: Vec<Vec<Reach>>,
}

/// Rows of a block that may differ from zero at the end of a substep, and those that are read on
/// the way there.
#[derive(Clone, Debug, PartialEq)]
struct Reach {
    written: Range<usize>,
    read: Range<usize>,
}

impl<V: Simd> Sensitivities<V> {
    /// Room for the derivatives by all variables, for a method of `stages` stages.
    pub(super) fn new(pattern: &SparsityPattern, stages: usize, zero: V) -> Self {
        let (states, variables) = (pattern.rows(), pattern.columns());
        // Each block reads the entries of the Jacobian again, which is as much work as a column.
        let width = WIDTHS.into_iter().min_by_key(|width| variables.div_ceil(*width) * (width + 1));
        let width = width.unwrap_or(1);
        let blocks = variables.div_ceil(width);
        let block = variables * width;
        let reach = reach(pattern, stages, width, blocks);
        Self {
            width,
            variables,
            states,
            blocks,
            numbers: vec![zero; (blocks + 2) * block],
            slopes: vec![zero; stages * states * width],
            reach,
        }
    }

    /// Sets them to those of a step of no length: the identity.
    #[inline(always)]
    pub(super) fn reset(&mut self, zero: V) {
        let Self { width, variables, blocks, .. } = *self;
        let one = zero.constant(1.0);
        for block in 0..blocks {
            let numbers = &mut self.numbers[block * variables * width..][..variables * width];
            numbers.fill(zero);
            for column in 0..width.min(variables - block * width) {
                numbers[(block * width + column) * width + column] = one;
            }
        }
    }

    /// The derivative of a state by a variable.
    #[inline(always)]
    pub(super) fn get(&self, state: usize, variable: usize) -> V {
        let (block, column) = (variable / self.width, variable % self.width);
        self.numbers[(block * self.variables + state) * self.width + column]
    }

    /// Takes the derivatives by the first `columns` variables through a substep, by the entries of
    /// the Jacobian at all its stages.
    #[inline(always)]
    pub(super) fn propagate(
        &mut self,
        substep: &Substep<'_, V>,
        columns: usize,
        zero: V,
    ) {
        let blocks = columns.div_ceil(self.width);
        let width = self.width;
        let parts = Propagate { sensitivities: self, substep, blocks, zero };
        match width {
            2 => zero.vectorize(Columns::<V, 2>(parts)),
            3 => zero.vectorize(Columns::<V, 3>(parts)),
            4 => zero.vectorize(Columns::<V, 4>(parts)),
            6 => zero.vectorize(Columns::<V, 6>(parts)),
            _ => zero.vectorize(Columns::<V, 8>(parts)),
        }
    }
}

/// What a substep does to the sensitivities.
#[derive(Debug)]
pub(super) struct Substep<'a, V> {
    pub(super) number: usize,
    pub(super) pattern: &'a SparsityPattern,
    /// The entries of the Jacobian, stage by stage.
    pub(super) entries: &'a [V],
    /// What makes each stage from the second on, and the result.
    pub(super) combinations: &'a [Combination],
}

struct Propagate<'a, V> {
    sensitivities: &'a mut Sensitivities<V>,
    substep: &'a Substep<'a, V>,
    blocks: usize,
    zero: V,
}

/// The same, with `W` columns in a block.
struct Columns<'a, V, const W: usize>(Propagate<'a, V>);

impl<V: Simd, const W: usize> Work for Columns<'_, V, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Propagate { sensitivities, substep, blocks, zero } = self.0;
        let Sensitivities { variables, states, numbers, slopes, reach, .. } = sensitivities;
        let (variables, states) = (*variables, *states);
        let buffers = numbers.len() / W - 2 * variables;
        let reach = &reach[substep.number.min(reach.len() - 1)];
        let (rows, _) = numbers.as_chunks_mut::<W>();
        let (slopes, _) = slopes.as_chunks_mut::<W>();
        for (block, reach) in reach.iter().enumerate().take(blocks) {
            let begin = block * variables;
            // Rows of other blocks are left in the buffers.
            for buffer in [buffers, buffers + variables] {
                rows[buffer..][reach.read.clone()].fill([zero; W]);
                rows.copy_within(begin + states..begin + variables, buffer + states);
            }
            let mut from = begin;
            for (s, combination) in substep.combinations.iter().enumerate() {
                let is_last = s + 1 == substep.combinations.len();
                let to = if is_last { begin } else { buffers + s % 2 * variables };
                let stage = Stage { from, begin, to, states, s, combination };
                stage.run(rows, slopes, substep, reach.written.clone(), zero);
                from = to;
            }
        }
    }
}

/// Where the rows of a stage are: those it is computed from, those at the beginning of the substep,
/// and those of the next stage.
struct Stage<'a> {
    from: usize,
    begin: usize,
    to: usize,
    states: usize,
    s: usize,
    combination: &'a Combination,
}

impl Stage<'_> {
    #[inline(always)]
    fn run<V: Simd, const W: usize>(
        &self,
        rows: &mut [[V; W]],
        slopes: &mut [[V; W]],
        substep: &Substep<'_, V>,
        range: Range<usize>,
        zero: V,
    ) {
        let Self { from, begin, to, states, s, combination } = *self;
        let pattern = substep.pattern;
        let entries = &substep.entries[s * pattern.entries()..][..pattern.entries()];
        let last = zero.constant(combination.last);
        for i in range {
            let mut slope = [zero; W];
            let row = pattern.row(i);
            for (&place, &entry) in pattern.places()[row.clone()].iter().zip(&entries[row]) {
                let factors = &rows[from + place];
                for c in 0..W {
                    slope[c] = factors[c].mul_add(entry, slope[c]);
                }
            }
            let mut next = rows[begin + i];
            for &(j, factor) in &combination.earlier {
                let (slope, factor) = (&slopes[j * states + i], zero.constant(factor));
                for c in 0..W {
                    next[c] = slope[c].mul_add(factor, next[c]);
                }
            }
            for c in 0..W {
                next[c] = slope[c].mul_add(last, next[c]);
            }
            slopes[s * states + i] = slope;
            rows[to + i] = next;
        }
    }
}

/// How far the blocks' columns have come after each substep, until nothing changes any more.
fn reach(
    pattern: &SparsityPattern,
    stages: usize,
    width: usize,
    blocks: usize,
) -> Vec<Vec<Reach>> {
    let states = pattern.rows();
    let mut at: Vec<Range<usize>> = (0..blocks)
        .map(|block| {
            let begin = (block * width).min(states);
            begin..((block + 1) * width).min(states)
        })
        .collect();
    let mut all: Vec<Vec<Reach>> = Vec::new();
    loop {
        let mut substep = Vec::new();
        for (block, at) in at.iter_mut().enumerate() {
            let columns = block * width..(block + 1) * width;
            for _ in 0..stages {
                *at = spread(pattern, at, &columns);
            }
            substep.push(Reach { written: at.clone(), read: neighbours(pattern, at) });
        }
        if all.last() == Some(&substep) {
            return all;
        }
        all.push(substep);
    }
}

/// The smallest range with `at` and the rows that have an entry in it, or in a column of an input
/// or a parameter that is among `columns`.
fn spread(
    pattern: &SparsityPattern,
    at: &Range<usize>,
    columns: &Range<usize>,
) -> Range<usize> {
    let states = pattern.rows();
    let mut range = at.clone();
    for i in 0..states {
        let places = &pattern.places()[pattern.row(i)];
        let reached =
            |place: &usize| at.contains(place) || *place >= states && columns.contains(place);
        if places.iter().any(reached) {
            range = if range.is_empty() { i..i + 1 } else { range.start.min(i)..range.end.max(i + 1) };
        }
    }
    range
}

/// The smallest range with `at` and the states that its rows have entries of.
fn neighbours(pattern: &SparsityPattern, at: &Range<usize>) -> Range<usize> {
    let mut range = at.clone();
    for i in at.clone() {
        for &place in &pattern.places()[pattern.row(i)] {
            if place < pattern.rows() {
                range = range.start.min(place)..range.end.max(place + 1);
            }
        }
    }
    range
}
