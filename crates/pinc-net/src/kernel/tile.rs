//! A tile of panels through the net, forwards and backwards, in memory that stays in cache.

use super::dense::{Cell, PackedLayer, accumulate, accumulate_wide, multiply};
use super::panels::{Pair, Panel, Panels};
use super::physics::{Physics, PlantBuffers, Term};
use crate::Normalizer;
use crate::mlp::Mlp;
use faer::prelude::ReborrowMut;
use faer::{ColMut, MatMut};
use pinc_ad::simd::{Simd, Work, tanh_all};
use std::ops::Range;

/// Points of a tile. Panels go through the net one by one, in the first-level cache; weight
/// gradients are summed over a tile, so that their sums are read and written once per tile.
const TILE_POINTS: usize = 128;

/// The most weights of a layer whose gradient is summed lane by lane: 128 KB with AVX-512. In
/// larger layers these sums would leave the second-level cache between two tiles.
const MAX_WEIGHTS_IN_LANES: usize = 2048;

/// Panels of a tile.
pub(super) const fn tile_panels<V: Simd>() -> usize {
    TILE_POINTS / (2 * V::LANES)
}

/// One thread's memory.
#[derive(Debug)]
pub(super) struct Workspace<V> {
    /// Shapes (inputs, outputs) of the layers.
    shapes: Vec<(usize, usize)>,
    /// Panels that go through a layer one after the other before the next: one, which then stays in
    /// the first-level cache, or in nets with wide layers, whose weights would not stay with it,
    /// all of a tile.
    together: usize,
    /// Input of each layer, `[panels, inputs]`, and last the output of the net.
    activations: Vec<Vec<Cell<V>>>,
    /// Derivative of the loss in each layer's output before tanh, `[panels, outputs]`.
    adjoints: Vec<Vec<Cell<V>>>,
    /// Derivative in each parameter, spread over lanes, except for the weights of wide layers.
    gradient: Vec<V>,
    /// Derivative in each weight of the wide layers.
    wide_gradient: Vec<f64>,
    /// Derivatives of a panel's errors in the outputs of the net, `[errors, states]`: one error per
    /// state, and one more where derivatives are fitted.
    seeds: Vec<Cell<V>>,
    /// Derivatives of these in the unknown parameters, `[errors, unknown parameters]`.
    unknown_seeds: Vec<Pair<V>>,
    scratch: PlantBuffers<V>,
    zero: V,
}

impl<V: Simd> Workspace<V> {
    pub(super) fn new(mlp: &Mlp, dims: pinc_ode::Dims, unknown: usize, zero: V) -> Self {
        let cells = |width: usize| vec![[zero; 4]; width * tile_panels::<V>()];
        let shapes: Vec<_> = mlp.layers().map(|l| (l.inputs, l.outputs)).collect();
        let wide = shapes.iter().filter(|&&shape| is_wide(shape));
        let wide: usize = wide.map(|(width, height)| width * height).sum();
        Self {
            shapes,
            together: if wide > 0 { tile_panels::<V>() } else { 1 },
            activations: mlp.widths().iter().map(|&w| cells(w)).collect(),
            adjoints: mlp.widths()[1..].iter().map(|&w| cells(w)).collect(),
            gradient: vec![zero; mlp.parameters().len() - wide + unknown],
            wide_gradient: vec![0.0; wide],
            seeds: vec![[zero; 4]; 2 * dims.nx * dims.nx],
            unknown_seeds: vec![[zero; 2]; 2 * dims.nx * unknown],
            scratch: PlantBuffers::new(dims, unknown, zero),
            zero,
        }
    }
}

/// Whether a layer of this shape is wide.
fn is_wide((width, height): (usize, usize)) -> bool {
    width * height > MAX_WEIGHTS_IN_LANES
}

/// Panels on their way through the net, in one thread's memory.
pub(super) struct Pass<'a, V> {
    pub(super) layers: &'a [PackedLayer],
    pub(super) input: &'a Normalizer,
    pub(super) physics: &'a Physics<V>,
    pub(super) term: Term,
    /// Factor of the squared errors in the loss.
    pub(super) weight: f64,
    pub(super) panels: &'a Panels<V>,
    pub(super) range: Range<usize>,
    pub(super) workspace: &'a mut Workspace<V>,
}

/// The loss and gradient of a block of panels: the unit of work of a thread. Blocks do not depend
/// on the number of threads, and their results are added in order, so that neither do the sums.
pub(super) struct BlockTask<'a, V> {
    pub(super) pass: Pass<'a, V>,
    /// Where the gradient goes; without it only the loss is computed.
    pub(super) gradient: Option<&'a mut [f64]>,
}

impl<V: Simd> Work for BlockTask<'_, V> {
    /// The sum of squared errors.
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let Self { mut pass, gradient } = self;
        let zero = pass.workspace.zero;
        let mut loss = zero;
        pass.workspace.gradient.fill(zero);
        pass.workspace.wide_gradient.fill(0.0);
        let (tile, together) = (tile_panels::<V>(), pass.workspace.together);
        for first in pass.range.clone().step_by(tile) {
            let count = tile.min(pass.range.end - first);
            for group in (0..count).step_by(together) {
                let places = group..count.min(group + together);
                pass.forward(first, places.clone());
                for place in places.clone() {
                    let panel = pass.panels.panel(first + place);
                    loss = loss + pass.outputs(panel, place);
                }
                if gradient.is_some() {
                    pass.backward(places);
                }
            }
            if gradient.is_some() {
                pass.accumulate(count);
            }
        }
        if let Some(gradient) = gradient {
            pass.workspace.add_up_lanes(gradient);
        }
        loss.sum()
    }
}

/// The Jacobian of the weighted errors of a few panels, into the columns of a matrix.
pub(super) struct Jacobian<'a, V> {
    pub(super) pass: Pass<'a, V>,
    /// A column per parameter; a row per lane and error, panel by panel.
    pub(super) out: MatMut<'a, f64>,
}

impl<V: Simd> Work for Jacobian<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { mut pass, mut out } = self;
        let errors = pass.panels.point_errors();
        let mut row = 0;
        for panel in pass.range.clone() {
            pass.forward(panel, 0..1);
            pass.linearize(pass.panels.panel(panel));
            for error in 0..errors {
                pass.seed(error);
                pass.backward(0..1);
                pass.write_rows(row, error, out.rb_mut());
                row += 2 * V::LANES;
            }
        }
    }
}

impl<V: Simd> Pass<'_, V> {
    /// `a_0` = normalized (t, y0, u), `a_(l+1)` = tanh(`W_l` `a_l` + `b_l`), with tangents, of
    /// the panels from `first` on that belong to `places`.
    #[inline(always)]
    fn forward(&mut self, first: usize, places: Range<usize>) {
        for place in places.clone() {
            self.enter(self.panels.panel(first + place), place);
        }
        let Workspace { shapes, activations, zero, .. } = &mut *self.workspace;
        for (l, layer) in self.layers.iter().enumerate() {
            let (width, height) = shapes[l];
            let (known, next) = activations.split_at_mut(l + 1);
            for place in places.clone() {
                let input = &known[l][place * width..(place + 1) * width];
                let output = &mut next[0][place * height..(place + 1) * height];
                multiply(&layer.forward, Some(&layer.bias), input, output, *zero);
                if l + 1 < self.layers.len() {
                    activate(output);
                }
            }
        }
    }

    /// The input of the net.
    #[inline(always)]
    fn enter(&mut self, panel: Panel<'_, V>, place: usize) {
        let Workspace { shapes, activations, zero, .. } = &mut *self.workspace;
        let width = shapes[0].0;
        let inputs = &mut activations[0][place * width..(place + 1) * width];
        for (i, (cell, row)) in inputs.iter_mut().zip(panel.rows).enumerate() {
            let inverse = 1.0 / self.input.std[i];
            let [first, second] = match (panel.slopes, i) {
                (None, 0) => [zero.constant(inverse); 2],
                (None, _) | (Some(_), 0) => [*zero; 2],
                (Some(slopes), _) => slopes.direction[i - 1].map(|v| v * inverse),
            };
            let mean = self.input.mean[i];
            *cell = [(row[0] - mean) * inverse, (row[1] - mean) * inverse, first, second];
        }
    }

    /// The squared errors, and the derivatives of the loss in the outputs of the net.
    #[inline(always)]
    fn outputs(&mut self, panel: Panel<'_, V>, place: usize) -> V {
        let Workspace { shapes, activations, adjoints, gradient, scratch, .. } =
            &mut *self.workspace;
        let last = shapes.len() - 1;
        let range = place * shapes[last].1..(place + 1) * shapes[last].1;
        let output = &activations[last + 1][range.clone()];
        let adjoint = &mut adjoints[last][range];
        let squares = self.physics.panel(self.term, self.weight, panel, output, adjoint, scratch);
        // The derivatives in the plant's parameters follow those in the net's.
        for (sum, part) in gradient.iter_mut().rev().zip(scratch.unknown_adjoint.iter().rev()) {
            *sum = *sum + *part;
        }
        squares
    }

    /// The derivatives of all errors of the panel in place 0 in the outputs of the net.
    #[inline(always)]
    fn linearize(&mut self, panel: Panel<'_, V>) {
        let Workspace { shapes, activations, seeds, unknown_seeds, scratch, .. } =
            &mut *self.workspace;
        let last = shapes.len() - 1;
        let output = &activations[last + 1][..shapes[last].1];
        let seeds = (&mut seeds[..], &mut unknown_seeds[..]);
        self.physics.linearize(self.term, self.weight, panel, output, seeds, scratch);
    }

    /// Starts a backward pass in place 0 from one error alone.
    #[inline(always)]
    fn seed(&mut self, error: usize) {
        let Workspace { shapes, adjoints, seeds, .. } = &mut *self.workspace;
        let last = shapes.len() - 1;
        let states = shapes[last].1;
        adjoints[last][..states].copy_from_slice(&seeds[error * states..(error + 1) * states]);
    }

    /// Writes the derivatives of an error in each parameter, from the adjoints in place 0: two
    /// vectors a column, from `row` on.
    #[inline(always)]
    fn write_rows(&self, row: usize, error: usize, mut out: MatMut<'_, f64>) {
        let Workspace { shapes, activations, adjoints, unknown_seeds, .. } = &*self.workspace;
        let mut columns = out.rb_mut().col_iter_mut();
        for (l, &(width, height)) in shapes.iter().enumerate() {
            let adjoints = &adjoints[l][..height];
            for adjoint in adjoints {
                for a in &activations[l][..width] {
                    let first = adjoint[0].mul_add(a[0], adjoint[2] * a[2]);
                    let second = adjoint[1].mul_add(a[1], adjoint[3] * a[3]);
                    write_rows(columns.next(), row, first, second);
                }
            }
            for adjoint in adjoints {
                write_rows(columns.next(), row, adjoint[0], adjoint[1]);
            }
        }
        let unknown = self.physics.unknown.len();
        for [first, second] in &unknown_seeds[error * unknown..(error + 1) * unknown] {
            write_rows(columns.next(), row, *first, *second);
        }
    }

    /// Adjoints of all layers, from the last to the first.
    #[inline(always)]
    fn backward(&mut self, places: Range<usize>) {
        let Workspace { shapes, activations, adjoints, zero, .. } = &mut *self.workspace;
        for (l, layer) in self.layers.iter().enumerate().skip(1).rev() {
            let (width, height) = shapes[l];
            let (below, above) = adjoints.split_at_mut(l);
            for place in places.clone() {
                let adjoint = &above[0][place * height..(place + 1) * height];
                let range = place * width..(place + 1) * width;
                let result = &mut below[l - 1][range.clone()];
                multiply(&layer.backward, None, adjoint, result, *zero);
                through_tanh(&activations[l][range], result);
            }
        }
    }

    /// Adds the gradient of `count` panels.
    #[inline(always)]
    fn accumulate(&mut self, count: usize) {
        let Workspace { shapes, activations, adjoints, gradient, wide_gradient, .. } =
            &mut *self.workspace;
        let (mut rest, mut wide) = (&mut gradient[..], &mut wide_gradient[..]);
        for (l, &(width, height)) in shapes.iter().enumerate() {
            let adjoint = &adjoints[l][..count * height];
            let (input, shape) = (&activations[l], (count, height, width));
            if is_wide((width, height)) {
                let (weight, after) = wide.split_at_mut(width * height);
                wide = after;
                accumulate_wide(adjoint, input, weight, shape);
            } else {
                let (weight, after) = rest.split_at_mut(width * height);
                rest = after;
                accumulate(adjoint, input, weight, shape);
            }
            let (bias, after) = rest.split_at_mut(height);
            rest = after;
            for adjoint in adjoint.chunks_exact(height) {
                for (bias, adjoint) in bias.iter_mut().zip(adjoint) {
                    *bias = *bias + (adjoint[0] + adjoint[1]);
                }
            }
        }
    }
}

impl<V: Simd> Workspace<V> {
    /// The derivatives in all parameters, in their order.
    #[inline(always)]
    fn add_up_lanes(&self, gradient: &mut [f64]) {
        let (mut lanes, mut wide) = (self.gradient.iter(), self.wide_gradient.iter());
        // `to` comes last in each zip, so that none of it is lost where the others end.
        let mut to = gradient.iter_mut();
        for &(width, height) in &self.shapes {
            let mut in_lanes = width * height + height;
            if is_wide((width, height)) {
                in_lanes = height;
                let weights = wide.by_ref().take(width * height);
                weights.zip(to.by_ref()).for_each(|(from, to)| *to = *from);
            }
            lanes.by_ref().take(in_lanes).zip(to.by_ref()).for_each(|(from, to)| *to = from.sum());
        }
        // The unknown parameters of the plant.
        lanes.zip(to).for_each(|(from, to)| *to = from.sum());
    }
}

/// Two vectors into a column, from `row` on.
#[inline(always)]
fn write_rows<V: Simd>(column: Option<ColMut<'_, f64>>, row: usize, first: V, second: V) {
    if let Some(column) = column.and_then(ColMut::try_as_col_major_mut) {
        let to = &mut column.as_slice_mut()[row..row + 2 * V::LANES];
        first.write(to);
        second.write(&mut to[V::LANES..]);
    }
}

/// a = tanh z, a' = (1 - a^2) z', in place.
#[inline(always)]
fn activate<V: Simd>(cells: &mut [Cell<V>]) {
    let (groups, rest) = cells.as_chunks_mut::<4>();
    for [a, b, c, d] in groups {
        let mut values = [a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]];
        tanh_all(&mut values);
        for (cell, [first, second]) in [a, b, c, d].into_iter().zip(values.as_chunks::<2>().0) {
            set_activation(cell, *first, *second);
        }
    }
    for cell in rest {
        let mut values = [cell[0], cell[1]];
        tanh_all(&mut values);
        set_activation(cell, values[0], values[1]);
    }
}

/// The cell of a neuron with these activations, from the cell of its z.
#[inline(always)]
fn set_activation<V: Simd>(cell: &mut Cell<V>, first: V, second: V) {
    let slope = |a: V| a.neg_mul_add(a, a.constant(1.0));
    *cell = [first, second, slope(first) * cell[2], slope(second) * cell[3]];
}

/// From the adjoints of (a, a') to the adjoints of (z, z'), in place. With s = 1 - a^2 and a' = s
/// z': adj z' = s adj a', adj z = s adj a - 2 a a' adj a'.
#[inline(always)]
fn through_tanh<V: Simd>(activations: &[Cell<V>], adjoints: &mut [Cell<V>]) {
    for (activation, adjoint) in activations.iter().zip(adjoints) {
        for half in 0..2 {
            let (a, tangent) = (activation[half], activation[half + 2]);
            let (value, rate) = (adjoint[half], adjoint[half + 2]);
            let slope = a.neg_mul_add(a, a.constant(1.0));
            adjoint[half] = (a * tangent * 2.0).neg_mul_add(rate, slope * value);
            adjoint[half + 2] = slope * rate;
        }
    }
}
