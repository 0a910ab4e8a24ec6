//! The threads that share the work, and the instruction set they use.

use crate::{Isa, NetError};
use std::sync::Arc;

/// A pool of threads and an instruction set, shared by the loss and the optimizers. Results do not
/// depend on the number of threads.
#[derive(Clone, Debug)]
pub struct Workers {
    pub(crate) pool: Arc<rayon::ThreadPool>,
    pub(crate) isa: Isa,
}

impl Workers {
    /// `threads` threads (0: one per core) with the best instruction set of the machine.
    ///
    /// # Errors
    ///
    /// [`NetError::Threads`] if they cannot be started.
    pub fn new(threads: usize) -> Result<Self, NetError> {
        Self::with_isa(threads, Isa::detect())
    }

    /// `threads` threads (0: one per core) with the instruction set `isa`.
    ///
    /// # Errors
    ///
    /// [`NetError::Threads`] if they cannot be started.
    pub fn with_isa(threads: usize, isa: Isa) -> Result<Self, NetError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| NetError::Threads(error.into()))?;
        Ok(Self { pool: Arc::new(pool), isa })
    }

    /// The instruction set in use.
    #[must_use]
    pub fn isa(&self) -> Isa {
        self.isa
    }
}
