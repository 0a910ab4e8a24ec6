//! States and sensitivities of plants with few states: all loops have constant ends.

use super::propagation::MOST_PLACES;
use super::tableau::Stage;
use super::{SparseFunction, SparsityPattern};
use pinc_ad::simd::{Simd, Work};

/// States and columns of the sizes that are compiled.
const SIZES: [[usize; 2]; 7] = [[1, 3], [2, 3], [2, 4], [3, 4], [3, 6], [4, 6], [4, 8]];

/// The most columns of these.
const WIDEST: usize = 8;

/// The size by which derivatives by so many variables are computed, if there is code for it.
fn size(states: usize, columns: usize) -> Option<[usize; 2]> {
    SIZES.into_iter().find(|[n, w]| *n == states && *w >= columns)
}

/// The numbers of a small plant's step: per place the states, and a row of derivatives for each.
#[derive(Clone, Debug)]
pub(super) struct Small<V> {
    /// The size of the last step.
    size: [usize; 2],
    x: Vec<V>,
    rows: Vec<V>,
    jacobian: Entries,
}

/// Where the Jacobian has entries, row by row as if it had no zeros and [`WIDEST`] columns.
#[derive(Clone, Debug)]
struct Entries {
    /// Of each place, a bit.
    present: u64,
    /// Of each place, the number of its entry.
    numbers: Vec<usize>,
}

impl Entries {
    /// The entry of a place, if there is one; `entries` has the places of all in `memory`.
    #[inline(always)]
    fn at<V: Simd>(&self, place: usize, memory: &[V], entries: &[u16]) -> Option<V> {
        if self.present >> place & 1 == 0 {
            return None;
        }
        Some(memory[usize::from(entries[self.numbers[place]])])
    }
}

/// The steps to take.
pub(super) struct Steps<'a, F, V> {
    pub(super) rhs: &'a F,
    pub(super) stages: &'a [Stage],
    pub(super) substeps: usize,
    pub(super) memory: &'a mut [V],
    pub(super) zero: V,
}

impl<V: Simd> Small<V> {
    /// For a plant whose right-hand side has this Jacobian, if there is code of its size.
    pub(super) fn new(pattern: &SparsityPattern, zero: V) -> Option<Self> {
        let states = pattern.rows();
        let size = size(states, pattern.columns())?;
        let (mut present, mut numbers) = (0, vec![0; states * WIDEST]);
        for i in 0..states {
            for entry in pattern.row(i) {
                let place = i * WIDEST + pattern.places()[entry];
                present |= 1 << place;
                numbers[place] = entry;
            }
        }
        Some(Self {
            size,
            x: vec![zero; MOST_PLACES * states],
            rows: vec![zero; MOST_PLACES * states * WIDEST],
            jacobian: Entries { present, numbers },
        })
    }

    /// The derivative of a state by a variable.
    #[inline(always)]
    pub(super) fn get(&self, state: usize, variable: usize) -> V {
        self.rows[state * self.size[1] + variable]
    }

    /// Takes the state in the memory through the steps, with its derivatives by the first `columns`
    /// variables from the identity on.
    #[inline(always)]
    pub(super) fn run<F: SparseFunction>(&mut self, steps: Steps<'_, F, V>, columns: usize) {
        let zero = steps.zero;
        self.size = size(self.size[0], columns).unwrap_or(self.size);
        match self.size {
            [1, _] => zero.vectorize(Sized::<F, V, 1, 3>(self, steps)),
            [2, 3] => zero.vectorize(Sized::<F, V, 2, 3>(self, steps)),
            [2, _] => zero.vectorize(Sized::<F, V, 2, 4>(self, steps)),
            [3, 4] => zero.vectorize(Sized::<F, V, 3, 4>(self, steps)),
            [3, _] => zero.vectorize(Sized::<F, V, 3, 6>(self, steps)),
            [_, 6] => zero.vectorize(Sized::<F, V, 4, 6>(self, steps)),
            _ => zero.vectorize(Sized::<F, V, 4, 8>(self, steps)),
        }
    }
}

/// The steps of a plant of `N` states and at most `W` variables.
struct Sized<'a, F, V, const N: usize, const W: usize>(&'a mut Small<V>, Steps<'a, F, V>);

impl<F: SparseFunction, V: Simd, const N: usize, const W: usize> Work for Sized<'_, F, V, N, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(small, Steps { rhs, stages, substeps, memory, zero }) = self;
        let (x, _) = small.x.as_chunks_mut::<N>();
        let (rows, _) = small.rows.as_chunks_mut::<W>();
        let (rows, _) = rows.as_chunks_mut::<N>();
        let (Some(x), Some(rows)) =
            (x.first_chunk_mut::<MOST_PLACES>(), rows.first_chunk_mut::<MOST_PLACES>())
        else {
            return;
        };
        for i in 0..N {
            x[0][i] = memory[i];
            rows[0][i] = [zero; W];
            rows[0][i][i] = zero.constant(1.0);
        }
        for _ in 0..substeps {
            for (s, stage) in stages.iter().enumerate() {
                let places = rhs.linearize(memory);
                advance(x, rows, stage, &small.jacobian, memory, places, zero);
                let next = stages.get(s + 1).map_or(0, |stage| stage.input) % MOST_PLACES;
                memory[..N].copy_from_slice(&x[next]);
            }
        }
    }
}

/// Adds the slopes of a stage to what is made of them.
#[inline(always)]
fn advance<V: Simd, const N: usize, const W: usize>(
    x: &mut [[V; N]; MOST_PLACES],
    rows: &mut [[[V; W]; N]; MOST_PLACES],
    stage: &Stage,
    jacobian: &Entries,
    memory: &[V],
    places: &[u16],
    zero: V,
) {
    let (values, entries) = places.split_at(N);
    let input = stage.input % MOST_PLACES;
    for i in 0..N {
        let mut slope = [zero; W];
        for (j, row) in rows[input].iter().enumerate() {
            if let Some(entry) = jacobian.at(i * WIDEST + j, memory, entries) {
                for c in 0..W {
                    slope[c] = row[c].mul_add(entry, slope[c]);
                }
            }
        }
        for (c, slope) in slope.iter_mut().enumerate().skip(N) {
            if let Some(entry) = jacobian.at(i * WIDEST + c, memory, entries) {
                *slope = *slope + entry;
            }
        }
        let value = memory[usize::from(values[i])];
        for step in &stage.moves {
            let factor = zero.constant(step.factor);
            let (from, to) = (step.from % MOST_PLACES, step.to % MOST_PLACES);
            x[to][i] = value.mul_add(factor, x[from][i]);
            for c in 0..W {
                rows[to][i][c] = slope[c].mul_add(factor, rows[from][i][c]);
            }
        }
    }
}
