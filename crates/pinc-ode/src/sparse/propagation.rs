//! The sensitivities of a Runge-Kutta method: K = J S of each stage, with sparse J, and with S
//! where it is not zero.

use super::SparsityPattern;
use super::tableau::{Stage, places};
use pinc_ad::simd::{Simd, Work};
use std::ops::Range;

/// Numbers of columns that go through the method together.
const WIDTHS: [usize; 5] = [2, 3, 4, 6, 8];

/// What a block may take of the fastest memory, in bytes.
const FAST_MEMORY: usize = 33_000;

/// Places of a method, at most; a power of 2, so that a remainder spares the check of an index.
pub(super) const MOST_PLACES: usize = 8;

/// Addresses that differ by multiples of this are told apart late.
const ALIASING: usize = 4096;

/// Rows of a block that are in use together, at most, where the coupling is local.
const ROWS: usize = 32;

/// Derivatives of the state by the variables (x, u, p) at the start of a step, some columns, a
/// *block*, at a time.
///
/// Per block there is a row of [`Sensitivities::width`] columns for each variable; rows of inputs
/// and parameters do not change. The blocks are followed by places of the same size for stages.
#[derive(Clone, Debug)]
pub(super) struct Sensitivities<V> {
    width: usize,
    variables: usize,
    states: usize,
    blocks: usize,
    /// Rows from one place to the next.
    stride: usize,
    rows: Vec<Row>,
    numbers: Vec<V>,
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
    /// Room for the derivatives by all variables.
    pub(super) fn new(pattern: &SparsityPattern, stages: &[Stage], zero: V) -> Self {
        assert!(places(stages) <= MOST_PLACES, "places of the method");
        let (states, variables) = (pattern.rows(), pattern.columns());
        let column = places(stages) * variables.min(ROWS) * size_of::<V>();
        let fast = |width: &usize| *width == WIDTHS[0] || width * column <= FAST_MEMORY;
        // Each block takes the entries of the Jacobian again, which is as much work as two columns.
        let work = |width: &usize| variables.div_ceil(*width) * (width + 2);
        let width = WIDTHS.into_iter().filter(fast).min_by_key(work).unwrap_or(WIDTHS[0]);
        let blocks = variables.div_ceil(width);
        let stride = stride(variables, width * size_of::<V>(), places(stages));
        let rows = blocks * variables + (places(stages) - 1) * stride;
        let reach = reach(pattern, stages.len(), width, blocks);
        let numbers = vec![zero; rows * width];
        let spans = (0..states).map(|i| Row::new(pattern, i)).collect();
        Self { width, variables, states, blocks, stride, rows: spans, numbers, reach }
    }

    /// Sets the first `columns` to the identity's, as for a step of no length.
    #[inline(always)]
    pub(super) fn reset(&mut self, columns: usize, zero: V) {
        let Self { width, variables, .. } = *self;
        let one = zero.constant(1.0);
        for block in 0..columns.div_ceil(width) {
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
    pub(super) fn propagate(&mut self, substep: &Substep<'_, V>, columns: usize, zero: V) {
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

/// The entries of a row of the Jacobian: those by states, then those by inputs and parameters.
#[derive(Clone, Copy, Debug)]
struct Row {
    begin: usize,
    split: usize,
    end: usize,
}

impl Row {
    fn new(pattern: &SparsityPattern, i: usize) -> Self {
        let Range { start: begin, end } = pattern.row(i);
        let by_states = |place: &usize| *place < pattern.rows();
        let split = begin + pattern.places()[begin..end].partition_point(by_states);
        Self { begin, split, end }
    }
}

/// How many rows of `row` bytes lie between places of `rows` rows each: so many that the same rows
/// of two places are not at addresses that a processor takes for the same at first (by the last 12
/// bits), which would make a row wait for the ones before it to be written.
fn stride(rows: usize, row: usize, places: usize) -> usize {
    let apart = |stride: &usize| {
        (1..places)
            .all(|k| (ALIASING / 8..=ALIASING / 8 * 7).contains(&(k * stride * row % ALIASING)))
    };
    (rows..rows + 64).find(apart).unwrap_or(rows)
}

/// What a substep does to the sensitivities.
#[derive(Debug)]
pub(super) struct Substep<'a, V> {
    pub(super) number: usize,
    pub(super) pattern: &'a SparsityPattern,
    /// The entries of the Jacobian, stage by stage.
    pub(super) entries: &'a [V],
    pub(super) stages: &'a [Stage],
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
        let Sensitivities {
            variables,
            states,
            blocks: all,
            stride,
            rows: spans,
            numbers,
            reach,
            ..
        } = sensitivities;
        let (variables, states, stride, buffers) =
            (*variables, *states, *stride, *all * *variables);
        let reach = &reach[substep.number.min(reach.len() - 1)];
        let (rows, _) = numbers.as_chunks_mut::<W>();
        for (block, reach) in reach.iter().enumerate().take(blocks) {
            let begin = block * variables;
            // Rows of other blocks are left in the other places.
            for buffer in (buffers..rows.len()).step_by(stride) {
                rows[buffer + reach.read.start..buffer + reach.written.start].fill([zero; W]);
                rows[buffer + reach.written.end..buffer + reach.read.end].fill([zero; W]);
            }
            let mut bases = [begin; MOST_PLACES];
            for (k, base) in bases.iter_mut().enumerate().skip(1) {
                *base = buffers + (k - 1) * stride;
            }
            let has_inputs = (block + 1) * W > states;
            for (s, stage) in substep.stages.iter().enumerate() {
                let count = substep.pattern.entries();
                let entries = &substep.entries[s * count..][..count];
                let places = substep.pattern.places();
                let product = Product { spans, places, entries, has_inputs };
                advance(rows, &product, stage, &bases, reach.written.clone(), zero);
            }
        }
    }
}

/// J, where it acts.
struct Product<'a, V> {
    spans: &'a [Row],
    places: &'a [usize],
    entries: &'a [V],
    has_inputs: bool,
}

/// Computes the slopes of the rows in `range`, and makes the stage's moves with them. Place k
/// begins at row `bases[k]`.
#[inline(always)]
fn advance<V: Simd, const W: usize>(
    rows: &mut [[V; W]],
    product: &Product<'_, V>,
    stage: &Stage,
    bases: &[usize; MOST_PLACES],
    range: Range<usize>,
    zero: V,
) {
    let Product { spans, places, entries, has_inputs } = *product;
    let (begin, input) = (bases[0], bases[stage.input % MOST_PLACES]);
    for (i, &Row { begin: first, split, end }) in range.clone().zip(&spans[range]) {
        let mut slope = [zero; W];
        for (&place, &entry) in places[first..split].iter().zip(&entries[first..split]) {
            let factors = &rows[input + place];
            for c in 0..W {
                slope[c] = factors[c].mul_add(entry, slope[c]);
            }
        }
        if has_inputs {
            for (&place, &entry) in places[split..end].iter().zip(&entries[split..end]) {
                let factors = &rows[begin + place];
                for c in 0..W {
                    slope[c] = factors[c].mul_add(entry, slope[c]);
                }
            }
        }
        for step in &stage.moves {
            let factor = zero.constant(step.factor);
            let from = rows[bases[step.from % MOST_PLACES] + i];
            let to = &mut rows[bases[step.to % MOST_PLACES] + i];
            for c in 0..W {
                to[c] = slope[c].mul_add(factor, from[c]);
            }
        }
    }
}

/// How far the blocks' columns have come after each substep, until nothing changes any more.
fn reach(pattern: &SparsityPattern, stages: usize, width: usize, blocks: usize) -> Vec<Vec<Reach>> {
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
fn spread(pattern: &SparsityPattern, at: &Range<usize>, columns: &Range<usize>) -> Range<usize> {
    let states = pattern.rows();
    let mut range = at.clone();
    for i in 0..states {
        let places = &pattern.places()[pattern.row(i)];
        let reached =
            |place: &usize| at.contains(place) || *place >= states && columns.contains(place);
        if places.iter().any(reached) {
            range =
                if range.is_empty() { i..i + 1 } else { range.start.min(i)..range.end.max(i + 1) };
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
