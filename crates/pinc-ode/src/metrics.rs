//! Distances between two signals: the paper's IAE and RMSE, and mean squared errors.

/// Accumulates the tracking error `|y_ref - y|` over samples; one value serves both readings of the
/// paper, which differ in what is sampled (at steps k, or on the dense trace) and in whether the
/// absolute errors of several outputs are averaged or summed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracking {
    samples: usize,
    absolute: Vec<f64>,
    squared: Vec<f64>,
}

impl Tracking {
    /// No samples yet, for `outputs` controlled outputs.
    #[must_use]
    pub fn new(outputs: usize) -> Self {
        Self { samples: 0, absolute: vec![0.0; outputs], squared: vec![0.0; outputs] }
    }

    /// Adds a sample.
    ///
    /// # Panics
    ///
    /// If `reference` and `output` do not have one number per output.
    pub fn push(&mut self, reference: &[f64], output: &[f64]) {
        let outputs = self.absolute.len();
        assert_eq!((reference.len(), output.len()), (outputs, outputs), "one number per output");
        for (i, (r, y)) in reference.iter().zip(output).enumerate() {
            self.absolute[i] += (r - y).abs();
            self.squared[i] += (r - y).powi(2);
        }
        self.samples += 1;
    }

    /// The paper's IAE as printed, Eq. (`iae_prediction`): absolute errors summed over samples and
    /// averaged over outputs.
    #[must_use]
    pub fn iae_mean(&self) -> f64 {
        self.iae_sum() / self.absolute.len() as f64
    }

    /// The IAE of the paper's Table 1: absolute errors summed over samples and outputs.
    #[must_use]
    pub fn iae_sum(&self) -> f64 {
        // The empty sum is -0.
        0.0 + self.absolute.iter().sum::<f64>()
    }

    /// The paper's RMSE: the root of the mean square over samples, averaged over outputs. NaN
    /// without samples.
    #[must_use]
    pub fn rmse(&self) -> f64 {
        let roots = self.squared.iter().map(|s| (s / self.samples as f64).sqrt());
        roots.sum::<f64>() / self.squared.len() as f64
    }
}

/// Mean squared error over samples and outputs, each output divided by its `scale` first; with
/// `scale` all 1 this is Eq. (`mse_gen`). NaN without samples.
///
/// # Shapes
///
/// `predicted`, `truth`: `[samples, n]`, row by row; `scale`: `n`.
///
/// # Panics
///
/// If `predicted` and `truth` differ in length, or their length is not a multiple of
/// `scale`'s.
#[must_use]
pub fn mean_squared_error(predicted: &[f64], truth: &[f64], scale: &[f64]) -> f64 {
    assert_eq!(predicted.len(), truth.len(), "as many predictions as truths");
    assert!(predicted.len().is_multiple_of(scale.len()), "one scale per output");
    let scales = scale.iter().cycle();
    let squares = predicted.iter().zip(truth).zip(scales).map(|((p, t), s)| ((p - t) / s).powi(2));
    squares.sum::<f64>() / predicted.len() as f64
}
