//! States and inputs over time.

use crate::Dims;

/// A sampled trajectory: times, states and the inputs held from there on.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    dims: Dims,
    t: Vec<f64>,
    x: Vec<f64>,
    u: Vec<f64>,
}

impl Trajectory {
    /// An empty trajectory of a plant with these dimensions.
    #[must_use]
    pub fn new(dims: Dims) -> Self {
        Self { dims, t: Vec::new(), x: Vec::new(), u: Vec::new() }
    }

    /// Appends a sample at `t` seconds.
    ///
    /// # Panics
    ///
    /// If `x` and `u` are not of the trajectory's dimensions.
    pub fn push(&mut self, t: f64, x: &[f64], u: &[f64]) {
        assert_eq!((x.len(), u.len()), (self.dims.nx, self.dims.nu), "dimensions");
        self.t.push(t);
        self.x.extend_from_slice(x);
        self.u.extend_from_slice(u);
    }

    /// Sets the input of the last sample, which is known only once the plant goes on from there.
    ///
    /// # Panics
    ///
    /// If there is no sample, or `u` is not of the trajectory's dimensions.
    pub fn set_last_input(&mut self, u: &[f64]) {
        let last = self.u.len() - self.dims.nu;
        self.u[last..].copy_from_slice(u);
    }

    /// Removes all samples.
    pub fn clear(&mut self) {
        self.t.clear();
        self.x.clear();
        self.u.clear();
    }

    /// The numbers of states and inputs.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// How many samples there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// The times, in s.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.t
    }

    /// The state of sample `i`, shape `n`.
    ///
    /// # Panics
    ///
    /// If there is no sample `i`.
    #[must_use]
    pub fn state(&self, i: usize) -> &[f64] {
        &self.x[i * self.dims.nx..(i + 1) * self.dims.nx]
    }

    /// The input of sample `i`, shape `m`.
    ///
    /// # Panics
    ///
    /// If there is no sample `i`.
    #[must_use]
    pub fn input(&self, i: usize) -> &[f64] {
        &self.u[i * self.dims.nu..(i + 1) * self.dims.nu]
    }
}
