//! The normal matrix J'J of the residuals, for Gauss-Newton methods.
//!
//! The rows of the Jacobian are computed slab by slab; a few slabs at a time are filled, one per
//! thread, and then multiplied, the threads taking columns of the result. Which sums are made, and
//! in which order, depends on the number of points alone, so that the same bits come out on any
//! number of threads: each product is done by one thread, and slabs are added in order.

use super::tile::Jacobian;
use super::{LaneEngine, locked};
use faer::linalg::matmul::triangular::BlockStructure;
use faer::linalg::matmul::{self, triangular};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Mat, MatMut, MatRef, Par};
use pinc_ad::simd::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Rows of a slab: enough for a matrix product to run at full speed.
const SLAB_ROWS: usize = 256;

/// Slabs between two synchronizations of the threads.
const SLABS: usize = 8;

/// Columns of the result that a thread takes at a time.
const COLUMNS: usize = 128;

/// A part of the Jacobian: a row per residual, a column per parameter.
#[derive(Debug)]
pub(super) struct Slab {
    rows: usize,
    data: Mat<f64>,
}

impl Slab {
    fn empty() -> Self {
        Self { rows: 0, data: Mat::new() }
    }

    fn matrix(&self) -> MatRef<'_, f64> {
        self.data.as_ref().subrows(0, self.rows)
    }
}

impl<V: Simd> LaneEngine<V> {
    /// The lower triangle of J'J for the parameters in place.
    pub(super) fn add_up_normal_matrix(&mut self, mut out: MatMut<'_, f64>) {
        for mut column in out.rb_mut().col_iter_mut() {
            column.fill(0.0);
        }
        let parts = self.parts();
        let mut slabs = std::mem::take(&mut self.slabs);
        slabs.resize_with(SLABS, Slab::empty);
        for parts in parts.chunks(SLABS) {
            let slabs = &mut slabs[..parts.len()];
            let this = &*self;
            this.pool.install(|| {
                slabs.par_iter_mut().zip(parts).for_each(|(slab, part)| this.fill_slab(part, slab));
                add_products(slabs, out.rb_mut());
            });
        }
        self.slabs = slabs;
    }

    /// The sets' panels, in parts of a slab each.
    fn parts(&self) -> Vec<(usize, Range<usize>)> {
        let sets = self.sets.iter().enumerate();
        sets.flat_map(|(set, (_, panels))| {
            let (end, step) = (panels.len(), (SLAB_ROWS / self.panel_rows(set)).max(1));
            (0..end).step_by(step).map(move |start| (set, start..end.min(start + step)))
        })
        .collect()
    }

    /// Rows of the Jacobian for one panel of a set.
    fn panel_rows(&self, set: usize) -> usize {
        2 * V::LANES * self.sets[set].1.point_errors()
    }

    fn fill_slab(&self, (set, range): &(usize, Range<usize>), slab: &mut Slab) {
        slab.rows = range.len() * self.panel_rows(*set);
        if slab.data.nrows() < slab.rows {
            slab.data = Mat::zeros(slab.rows, self.parameters);
        }
        // One job per thread at a time: jobs do not wait for others while they hold the memory.
        let thread = rayon::current_thread_index().unwrap_or(0);
        let mut workspace = locked(&self.workspaces[thread]);
        let pass = self.pass(*set, range.clone(), &mut workspace);
        self.zero.vectorize(Jacobian { pass, out: slab.data.as_mut() });
    }
}

/// Adds the lower triangles of the slabs' J'J, in order.
fn add_products(slabs: &[Slab], out: MatMut<'_, f64>) {
    let mut strips = Vec::new();
    let mut rest = out;
    let mut first = 0;
    while rest.ncols() > 0 {
        let width = COLUMNS.min(rest.ncols());
        let (diagonal, _, below, trailing) = rest.split_at_mut(width, width);
        strips.push((first, diagonal, below));
        rest = trailing;
        first += width;
    }
    strips.into_par_iter().for_each(|(first, mut diagonal, mut below)| {
        for slab in slabs {
            add_strip(slab.matrix(), first, diagonal.rb_mut(), below.rb_mut());
        }
    });
}

/// Adds J'J in the columns from `first` on, from the diagonal block down.
fn add_strip(
    jacobian: MatRef<'_, f64>,
    first: usize,
    diagonal: MatMut<'_, f64>,
    below: MatMut<'_, f64>,
) {
    let width = diagonal.ncols();
    let own = jacobian.subcols(first, width);
    let after = jacobian.subcols(first + width, below.nrows());
    triangular::matmul(
        diagonal,
        BlockStructure::TriangularLower,
        Accum::Add,
        own.transpose(),
        BlockStructure::Rectangular,
        own.rb(),
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
    matmul::matmul(below, Accum::Add, after.transpose(), own, 1.0, Par::Seq);
}
