//! A tile of panels through the net, forwards and backwards, in memory that stays in cache.

use super::dense::{Cell, PackedLayer, accumulate, multiply};
use super::panels::{Panel, Panels};
use super::physics::{Physics, Scratch, Term};
use crate::Normalizer;
use crate::activation::tanh;
use crate::mlp::Mlp;
use crate::simd::{Simd, Work};
use pinc_ode::Plant;
use std::ops::Range;

/// Points of a tile. Panels go through the net one by one, in the first-level cache; weight gradients
/// are summed over a tile, so that their sums are read and written once per tile.
const TILE_POINTS: usize = 128;

/// Panels of a tile.
pub(super) const fn tile_panels<V: Simd>() -> usize {
    TILE_POINTS / (2 * V::LANES)
}

/// One thread's memory.
#[derive(Debug)]
pub(super) struct Workspace<V> {
    /// Shapes (inputs, outputs) of the layers.
    shapes: Vec<(usize, usize)>,
    /// Input of each layer, `[panels, inputs]`, and last the output of the net.
    activations: Vec<Vec<Cell<V>>>,
    /// Derivative of the loss in each layer's output before tanh, `[panels, outputs]`.
    adjoints: Vec<Vec<Cell<V>>>,
    /// Derivative in each parameter, spread over lanes.
    gradient: Vec<V>,
    scratch: Scratch<V>,
    zero: V,
}

impl<V: Simd> Workspace<V> {
    pub(super) fn new(mlp: &Mlp, dims: pinc_ode::Dims, zero: V) -> Self {
        let cells = |width: usize| vec![[zero; 4]; width * tile_panels::<V>()];
        Self {
            shapes: mlp.layers().map(|l| (l.inputs, l.outputs)).collect(),
            activations: mlp.widths().iter().map(|&w| cells(w)).collect(),
            adjoints: mlp.widths()[1..].iter().map(|&w| cells(w)).collect(),
            gradient: vec![zero; mlp.parameters().len()],
            scratch: Scratch::new(dims, zero),
            zero,
        }
    }
}

/// The loss and gradient of a block of panels: the unit of work of a thread. Blocks do not depend on the
/// number of threads, and their results are added in order, so that neither do the sums.
pub(super) struct Block<'a, V, P> {
    pub(super) layers: &'a [PackedLayer],
    pub(super) input: &'a Normalizer,
    pub(super) physics: &'a Physics<P>,
    pub(super) term: Term,
    /// Factor of the squared errors in the loss.
    pub(super) weight: f64,
    pub(super) panels: &'a Panels<V>,
    pub(super) range: Range<usize>,
    pub(super) workspace: &'a mut Workspace<V>,
    /// Where the gradient goes; without it only the loss is computed.
    pub(super) gradient: Option<&'a mut [f64]>,
}

impl<V: Simd, P: Plant> Work for Block<'_, V, P> {
    /// The sum of squared errors.
    type Output = f64;

    #[inline(always)]
    fn run(mut self) -> f64 {
        let mut loss = self.workspace.zero;
        let zero = self.workspace.zero;
        self.workspace.gradient.fill(zero);
        let tile = tile_panels::<V>();
        for first in self.range.clone().step_by(tile) {
            let count = tile.min(self.range.end - first);
            for place in 0..count {
                let panel = self.panels.panel(first + place);
                self.forward(panel, place);
                loss = loss + self.outputs(panel, place);
                if self.gradient.is_some() {
                    self.backward(place);
                }
            }
            if self.gradient.is_some() {
                self.accumulate(count);
            }
        }
        if let Some(gradient) = self.gradient {
            for (to, from) in gradient.iter_mut().zip(&self.workspace.gradient) {
                *to = from.sum();
            }
        }
        loss.sum()
    }
}

impl<V: Simd, P: Plant> Block<'_, V, P> {
    /// `a_0` = normalized (t, y0, u), `a_(l+1)` = tanh(`W_l` `a_l` + `b_l`), with time tangents.
    #[inline(always)]
    fn forward(&mut self, panel: Panel<'_, V>, place: usize) {
        let Workspace { shapes, activations, zero, .. } = &mut *self.workspace;
        let zero = *zero;
        let width = shapes[0].0;
        let inputs = &mut activations[0][place * width..(place + 1) * width];
        for (i, (cell, row)) in inputs.iter_mut().zip(panel.rows).enumerate() {
            let inverse = 1.0 / self.input.std[i];
            let tangent = zero.constant(if i == 0 { inverse } else { 0.0 });
            let [first, second] = row.map(|v| (v - self.input.mean[i]) * inverse);
            *cell = [first, second, tangent, tangent];
        }
        for (l, layer) in self.layers.iter().enumerate() {
            let (width, height) = shapes[l];
            let (known, next) = activations.split_at_mut(l + 1);
            let input = &known[l][place * width..(place + 1) * width];
            let output = &mut next[0][place * height..(place + 1) * height];
            multiply(&layer.forward, Some(&layer.bias), input, output, zero);
            if l + 1 < self.layers.len() {
                activate(output);
            }
        }
    }

    /// The squared errors, and the derivatives of the loss in the outputs of the net.
    #[inline(always)]
    fn outputs(&mut self, panel: Panel<'_, V>, place: usize) -> V {
        let Workspace { shapes, activations, adjoints, scratch, .. } = &mut *self.workspace;
        let last = shapes.len() - 1;
        let range = place * shapes[last].1..(place + 1) * shapes[last].1;
        let output = &activations[last + 1][range.clone()];
        let adjoint = &mut adjoints[last][range];
        self.physics.panel(self.term, self.weight, panel, output, adjoint, scratch)
    }

    /// Adjoints of all layers, from the last to the first.
    #[inline(always)]
    fn backward(&mut self, place: usize) {
        let Workspace { shapes, activations, adjoints, zero, .. } = &mut *self.workspace;
        for (l, layer) in self.layers.iter().enumerate().skip(1).rev() {
            let (width, height) = shapes[l];
            let (below, above) = adjoints.split_at_mut(l);
            let adjoint = &above[0][place * height..(place + 1) * height];
            let range = place * width..(place + 1) * width;
            let result = &mut below[l - 1][range.clone()];
            multiply(&layer.backward, None, adjoint, result, *zero);
            through_tanh(&activations[l][range], result);
        }
    }

    /// Adds the gradient of `count` panels.
    #[inline(always)]
    fn accumulate(&mut self, count: usize) {
        let Workspace { shapes, activations, adjoints, gradient, .. } = &mut *self.workspace;
        let mut rest = &mut gradient[..];
        for (l, &(width, height)) in shapes.iter().enumerate() {
            let (weight, after) = rest.split_at_mut(width * height);
            let (bias, after) = after.split_at_mut(height);
            rest = after;
            let adjoint = &adjoints[l][..count * height];
            accumulate(adjoint, &activations[l][..count * width], weight, (height, width));
            for adjoint in adjoint.chunks_exact(height) {
                for (bias, adjoint) in bias.iter_mut().zip(adjoint) {
                    *bias = *bias + (adjoint[0] + adjoint[1]);
                }
            }
        }
    }
}

/// a = tanh z, a' = (1 - a^2) z', in place.
#[inline(always)]
fn activate<V: Simd>(cells: &mut [Cell<V>]) {
    for cell in cells {
        for half in 0..2 {
            let a = tanh(cell[half]);
            let slope = a.neg_mul_add(a, a.constant(1.0));
            cell[half] = a;
            cell[half + 2] = slope * cell[half + 2];
        }
    }
}

/// From the adjoints of (a, a') to those of (z, z'), in place. With s = 1 - a^2 and a' = s z':
/// adj z' = s adj a', adj z = s adj a - 2 a a' adj a'.
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
