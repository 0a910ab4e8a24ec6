//! The weights of a net in the order in which its control interface reads them.

use crate::{FoldedNet, PlainLayer};

/// Maximum number of vectors of neurons that are computed together: three of values and nine of
/// tangents fit into the registers, with the weights.
const ROWS: usize = 3;

/// The layers of a [`FoldedNet`], transposed and padded.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) layers: Vec<FoldedLayer>,
    pub(super) packed: Vec<BlockedLayer>,
    lanes: usize,
    adds_initial_state: bool,
}

/// A layer, as blocks of rows.
#[derive(Clone, Debug)]
pub(super) struct FoldedLayer {
    /// Length of the input, without padding.
    pub(super) inputs: usize,
    pub(super) blocks: Vec<RowBlock>,
}

/// Some vectors of neurons of a layer.
#[derive(Clone, Debug)]
pub(super) struct RowBlock {
    /// Vectors of neurons.
    pub(super) rows: usize,
    /// Place of the first neuron in the layer's output.
    pub(super) first: usize,
    /// Shape `[rows, lanes]`; 0 where there is no neuron.
    pub(super) bias: Vec<f64>,
    /// Shape `[inputs, rows, lanes]`; 0 where there is no neuron.
    pub(super) weights: Vec<f64>,
}

impl Layout {
    /// The layout of `net` for vectors of so many lanes.
    pub(super) fn new(net: FoldedNet, lanes: usize) -> Self {
        let FoldedNet { layers, adds_initial_state, .. } = net;
        let arranged = layers.into_iter().map(|PlainLayer { weights, bias }| {
            (FoldedLayer::new(&weights, &bias, lanes), BlockedLayer::new(&weights, bias))
        });
        let (layers, packed) = arranged.unzip();
        Self { layers, packed, lanes, adds_initial_state }
    }

    /// Whether the state at the end is the initial state plus what the layers give.
    pub(super) fn adds_initial_state(&self) -> bool {
        self.adds_initial_state
    }

    /// The most neurons of a layer, or numbers of (x, u, p).
    pub(super) fn widest(&self) -> usize {
        let widths = self.packed.iter().map(|layer| layer.bias.len().max(layer.inputs));
        widths.max().unwrap_or(0)
    }

    /// Length of the longest input or output of a layer, with padding.
    pub(super) fn longest(&self) -> usize {
        let rows = |layer: &FoldedLayer| layer.blocks.iter().map(|block| block.rows).sum::<usize>();
        let outputs = self.layers.iter().map(|layer| rows(layer) * self.lanes);
        let inputs = self.layers.iter().map(|layer| layer.inputs);
        outputs.chain(inputs).max().unwrap_or(0)
    }
}

/// A layer's weights for points in the lanes.
#[derive(Clone, Debug)]
pub(super) struct BlockedLayer {
    /// Length of the input.
    pub(super) inputs: usize,
    pub(super) bias: Vec<f64>,
    /// Shape `[outputs, inputs]`.
    pub(super) rows: Vec<f64>,
    /// The weights in blocks of [`BlockedLayer::ROWS`] rows, each block column by column.
    pub(super) blocks: Vec<f64>,
}

impl BlockedLayer {
    /// Rows of a block; the last may have fewer.
    pub(super) const ROWS: usize = 4;

    fn new(weights: &[Vec<f64>], bias: Vec<f64>) -> Self {
        let inputs = weights[0].len();
        let column =
            |rows: &[Vec<f64>], k: usize| -> Vec<f64> { rows.iter().map(|w| w[k]).collect() };
        let block =
            |rows: &[Vec<f64>]| (0..inputs).flat_map(|k| column(rows, k)).collect::<Vec<_>>();
        Self {
            inputs,
            bias,
            rows: weights.concat(),
            blocks: weights.chunks(Self::ROWS).flat_map(block).collect(),
        }
    }
}

impl FoldedLayer {
    fn new(weights: &[Vec<f64>], bias: &[f64], lanes: usize) -> Self {
        let inputs = weights[0].len();
        let rows = bias.len().div_ceil(lanes);
        let count = rows.div_ceil(ROWS);
        // Evenly divided: 4 rows are 2 and 2, which keep more sums going than 3 and 1.
        let mut first = 0;
        let blocks = (0..count).map(|i| {
            let rows = (rows + i) / count;
            let neurons = first..first + rows * lanes;
            let at = |neuron: usize, input: usize| weights.get(neuron).map_or(0.0, |w| w[input]);
            let weights = (0..inputs).flat_map(|j| neurons.clone().map(move |k| (j, k)));
            let weights = weights.map(|(j, k)| at(k, j)).collect();
            let bias = neurons.clone().map(|k| bias.get(k).copied().unwrap_or(0.0)).collect();
            let block = RowBlock { rows, first, bias, weights };
            first = neurons.end;
            block
        });
        Self { inputs, blocks: blocks.collect() }
    }
}
