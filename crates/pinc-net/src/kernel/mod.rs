//! The batched kernel: loss and gradient over many points, in SIMD lanes, on several threads.
//!
//! # Layout
//!
//! Points come in *panels* of two vectors (16 points with AVX-512, 8 with AVX2). For a panel, each
//! neuron holds one *cell* of four vectors: two of values and two of tangents. Tangents are
//! derivatives in time or, if derivatives are fitted, along one direction per point. A panel goes
//! through the whole net and back while its cells stay in the first-level cache; the weight
//! gradients are then summed over a *tile* of panels, whose cells stay in the second-level cache.
//! A thread takes one *block* of tiles at a time.
//!
//! In nets with *wide* layers, the weights and their gradients, spread over lanes, do not stay in
//! cache from panel to panel. There all panels of a tile go through one layer before the next, and
//! the gradients of wide layers are summed over lanes tile by tile.
//!
//! The number of threads does not change a bit of the result: blocks depend only on the number of
//! points, and their sums are added in order. Different instruction sets round differently.

mod dense;
mod normal;
mod panels;
mod physics;
mod tile;

use crate::loss::{LossTerms, LossWeights};
use crate::mlp::to_f64;
use crate::net::PincNet;
use crate::sampling::Points;
use crate::{Measurements, Normalizer, Workers};
use dense::PackedLayer;
use faer::MatMut;
use normal::Slab;
use panels::Panels;
pub(crate) use physics::UnknownParameter;
use physics::{Physics, Term};
use pinc_ad::simd::{Simd, Task};
use pinc_ode::{AnyVectorRhs, Dims, DynRhs};
use std::fmt::Debug;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use tile::{BlockTask, Pass, Workspace, tile_panels};

/// Maximum number of blocks: enough to keep threads busy, few enough to be added quickly.
const MAX_BLOCKS: usize = 64;

/// The PINC loss over a set of points, `MSE_y` + lambda `MSE_F`, with its gradient in the
/// parameters of a net; where there are measurements, with their term.
///
/// Memory: (1 + n + m) numbers a point; per thread, about 16 KB per neuron of the widest layers for
/// cells and 64 bytes per parameter, 8 in wide layers; per block (64 at most), 8 bytes per
/// parameter.
#[derive(Debug)]
pub struct BatchLoss {
    engine: Box<dyn Engine>,
}

impl BatchLoss {
    /// The loss of `net`'s kind on `plant`, with no points yet.
    pub fn new(
        plant: &dyn DynRhs,
        net: &PincNet,
        weights: &LossWeights,
        workers: &Workers,
    ) -> Self {
        Self::of_unknown(plant, net, weights, &[], workers)
    }

    /// The loss of a net that takes no parameters, on a plant whose parameters are unknown: they
    /// are trained with the net. `start`, `np` numbers, is where they start. Behind the parameters
    /// of the net stands a variable q for each, and the plant's parameter is start + |start| q, or
    /// q where the start is 0.
    ///
    /// # Panics
    ///
    /// If `start` does not have one number per plant parameter, or the net takes parameters.
    pub fn inverse(
        plant: &dyn DynRhs,
        net: &PincNet,
        weights: &LossWeights,
        start: &[f64],
        workers: &Workers,
    ) -> Self {
        assert_eq!([start.len(), net.dims().np], [plant.dims().np, 0], "unknown parameters");
        let unknown: Vec<_> = start.iter().map(|&start| UnknownParameter::new(start)).collect();
        Self::of_unknown(plant, net, weights, &unknown, workers)
    }

    fn of_unknown(
        plant: &dyn DynRhs,
        net: &PincNet,
        weights: &LossWeights,
        unknown: &[UnknownParameter],
        workers: &Workers,
    ) -> Self {
        let rhs = plant.vectorized(workers.isa);
        let engine = workers.isa.dispatch(Build { rhs, net, weights, unknown, workers });
        Self { engine }
    }

    /// Replaces the points: collocation points for `MSE_F`, initial conditions for `MSE_y`. Either
    /// set may be empty; its term is then 0.
    pub fn set_points(&mut self, collocation: &Points, initial: &Points) {
        self.engine.set_points(collocation, initial);
    }

    /// Replaces the measurements, and the weight of their term.
    pub fn set_measurements(&mut self, measurements: &Measurements, weight: f64) {
        self.engine.set_measurements(measurements, weight);
    }

    /// The loss at `parameters`.
    ///
    /// # Panics
    ///
    /// If the number of parameters is not the net's.
    pub fn loss(&mut self, parameters: &[f64]) -> LossTerms {
        self.engine.evaluate(parameters, None)
    }

    /// The loss at `parameters`, and its gradient into `gradient`.
    ///
    /// # Panics
    ///
    /// If the numbers of parameters and of derivatives are not the number of the net's parameters
    /// and the plant's unknown ones.
    pub fn loss_gradient(&mut self, parameters: &[f64], gradient: &mut [f64]) -> LossTerms {
        self.engine.evaluate(parameters, Some(gradient))
    }

    /// The lower triangle of J'J at `parameters`, where J is the Jacobian of the residuals r whose
    /// squares add up to the loss, all weights included ([`crate::reference_residuals`]): the loss
    /// is |r|^2, its gradient 2 J'r, its Gauss-Newton Hessian 2 J'J. The rest of `out` becomes 0.
    ///
    /// Cost for P parameters: P^2/2 multiply-adds per residual, of which there are n per point; the
    /// Jacobian itself costs little beside that. Memory: 16 KB per parameter, whatever the number
    /// of points, kept for the next call. The result has the same bits on any number of threads.
    ///
    /// # Shapes
    ///
    /// `out`: `[P, P]`, column by column.
    ///
    /// # Panics
    ///
    /// If the number of parameters is not the net's, or `out` does not have that size.
    pub fn normal_matrix(&mut self, parameters: &[f64], out: &mut [f64]) {
        self.engine.normal_matrix(parameters, out);
    }
}

/// What [`BatchLoss`] does, for any vector type.
trait Engine: Debug + Send {
    fn set_points(&mut self, collocation: &Points, initial: &Points);
    fn set_measurements(&mut self, measurements: &Measurements, weight: f64);
    fn evaluate(&mut self, parameters: &[f64], gradient: Option<&mut [f64]>) -> LossTerms;
    fn normal_matrix(&mut self, parameters: &[f64], out: &mut [f64]);
}

/// Makes the engine for the vector type of the instruction set.
struct Build<'a> {
    rhs: AnyVectorRhs,
    net: &'a PincNet,
    weights: &'a LossWeights,
    unknown: &'a [UnknownParameter],
    workers: &'a Workers,
}

impl Task for Build<'_> {
    type Output = Box<dyn Engine>;

    fn run<V: Simd>(self, zero: V) -> Box<dyn Engine> {
        let Self { rhs, net, weights, unknown, workers } = self;
        let pool = Arc::clone(&workers.pool);
        let dims = net.dims();
        let workspace = || Mutex::new(Workspace::new(&net.mlp, dims, unknown.len(), zero));
        Box::new(LaneEngine {
            dims,
            layers: net.mlp.layers().map(|l| PackedLayer::new(l, V::ROWS)).collect(),
            input: net.input.clone(),
            physics: Physics {
                plant: rhs.on(),
                ansatz: net.ansatz,
                sample_time_s: net.sample_time_s,
                output: net.output.clone(),
                residual_scale: weights.residual_scale.clone(),
                initial_scale: weights.initial_scale.clone(),
                derivatives: weights.derivatives,
                unknown: unknown.to_vec(),
            },
            lambda: weights.lambda,
            measured: 0.0,
            sets: Vec::new(),
            parameters: net.mlp.parameters().len() + unknown.len(),
            blocks: Vec::new(),
            slabs: Vec::new(),
            workspaces: (0..pool.current_num_threads()).map(|_| workspace()).collect(),
            pool,
            zero,
        })
    }
}

#[derive(Debug)]
struct LaneEngine<V> {
    dims: Dims,
    layers: Vec<PackedLayer>,
    input: Normalizer,
    physics: Physics<V>,
    lambda: f64,
    measured: f64,
    sets: Vec<(Term, Panels<V>)>,
    parameters: usize,
    blocks: Vec<Mutex<BlockResult>>,
    slabs: Vec<Slab>,
    workspaces: Vec<Mutex<Workspace<V>>>,
    pool: Arc<rayon::ThreadPool>,
    zero: V,
}

/// A block's place and, after an evaluation, its share of the sums.
#[derive(Debug)]
struct BlockResult {
    set: usize,
    range: Range<usize>,
    squares: f64,
    gradient: Vec<f64>,
}

impl<V: Simd> LaneEngine<V> {
    /// Factor of a set's squared errors in the loss.
    fn weight(&self, set: usize) -> f64 {
        let (term, panels) = &self.sets[set];
        let mean = 1.0 / to_f64(panels.errors());
        match term {
            Term::Physics => self.lambda * mean,
            Term::Initial => mean,
            Term::Measured => self.measured * mean,
        }
    }

    fn fill(&mut self, parameters: &[f64]) {
        assert_eq!(parameters.len(), self.parameters, "number of parameters");
        for layer in &mut self.layers {
            layer.fill(parameters);
        }
        // Behind the net's.
        let unknown = &mut self.physics.unknown;
        let (_, q) = parameters.split_at(parameters.len() - unknown.len());
        for (unknown, &q) in unknown.iter_mut().zip(q) {
            unknown.value = unknown.at(q);
        }
    }

    /// The panels `range` of a set, ready to go through the net.
    fn pass<'a>(
        &'a self,
        set: usize,
        range: Range<usize>,
        workspace: &'a mut Workspace<V>,
    ) -> Pass<'a, V> {
        let (term, panels) = &self.sets[set];
        Pass {
            layers: &self.layers,
            input: &self.input,
            physics: &self.physics,
            term: *term,
            weight: self.weight(set),
            panels,
            range,
            workspace,
        }
    }

    fn run_block(&self, block: &mut BlockResult, workspace: &mut Workspace<V>, gradient: bool) {
        block.squares = self.zero.vectorize(BlockTask {
            pass: self.pass(block.set, block.range.clone(), workspace),
            gradient: gradient.then_some(&mut block.gradient),
        });
    }
}

/// The value behind a lock. A thread that panicked left nothing inconsistent: all is recomputed.
fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl<V: Simd> Engine for LaneEngine<V> {
    fn set_points(&mut self, collocation: &Points, initial: &Points) {
        self.replace(Term::Physics, Panels::new(collocation, self.dims, self.zero));
        let own = |k: usize, state: usize| Some(initial.state(k)[state]);
        self.replace(Term::Initial, Panels::aimed(initial, own, self.dims, self.zero));
        self.divide();
    }

    fn set_measurements(&mut self, measurements: &Measurements, weight: f64) {
        self.measured = weight;
        let measured = |k: usize, state: usize| measurements.state(k)[state];
        let mut panels = Panels::aimed(measurements.points(), measured, self.dims, self.zero);
        if measurements.has_slopes() {
            panels.add_slopes(measurements, self.zero);
        }
        self.replace(Term::Measured, panels);
        self.divide();
    }

    fn evaluate(&mut self, parameters: &[f64], gradient: Option<&mut [f64]>) -> LossTerms {
        self.fill(parameters);
        let with_gradient = gradient.is_some();
        let next = AtomicUsize::new(0);
        let this = &*self;
        this.pool.broadcast(|thread| {
            let mut workspace = locked(&this.workspaces[thread.index()]);
            while let Some(block) = this.blocks.get(next.fetch_add(1, Ordering::Relaxed)) {
                this.run_block(&mut locked(block), &mut workspace, with_gradient);
            }
        });
        self.collect(gradient)
    }

    fn normal_matrix(&mut self, parameters: &[f64], out: &mut [f64]) {
        let size = self.parameters;
        assert_eq!(out.len(), size * size, "size of J'J");
        self.fill(parameters);
        self.add_up_normal_matrix(MatMut::from_column_major_slice_mut(out, size, size));
    }
}

impl<V: Simd> LaneEngine<V> {
    /// Replaces the points of a term. Terms keep their order, whichever is set first.
    fn replace(&mut self, term: Term, panels: Panels<V>) {
        self.sets.retain(|(other, _)| *other != term);
        if panels.errors() > 0 {
            self.sets.push((term, panels));
            self.sets.sort_by_key(|(term, _)| *term);
        }
    }

    /// Divides the points into blocks.
    fn divide(&mut self) {
        self.blocks.clear();
        for (set, (_, panels)) in self.sets.iter().enumerate() {
            let tile = tile_panels::<V>();
            let tiles = panels.len().div_ceil(tile);
            let step = tile * tiles.div_ceil(MAX_BLOCKS);
            for start in (0..panels.len()).step_by(step) {
                let range = start..panels.len().min(start + step);
                let gradient = vec![0.0; self.parameters];
                self.blocks.push(Mutex::new(BlockResult { set, range, squares: 0.0, gradient }));
            }
        }
    }

    /// Adds up the blocks, in order.
    fn collect(&self, mut gradient: Option<&mut [f64]>) -> LossTerms {
        if let Some(gradient) = gradient.as_deref_mut() {
            assert_eq!(gradient.len(), self.parameters, "number of derivatives");
            gradient.fill(0.0);
        }
        let mut terms = LossTerms::default();
        for block in &self.blocks {
            let block = locked(block);
            let share = self.weight(block.set) * block.squares;
            match self.sets[block.set].0 {
                Term::Physics => terms.physics += share,
                Term::Initial => terms.data += share,
                Term::Measured => terms.measured += share,
            }
            if let Some(gradient) = gradient.as_deref_mut() {
                for (sum, part) in gradient.iter_mut().zip(&block.gradient) {
                    *sum += part;
                }
            }
        }
        terms
    }
}
