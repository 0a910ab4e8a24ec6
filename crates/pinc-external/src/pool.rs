//! Copies of a simulator, one for each request that runs at the same time.

use pinc_ode::OdeError;
use std::fmt::{self, Debug};
use std::sync::{Mutex, PoisonError};

/// Copies that wait for work. Each thread that asks takes one, or starts a new one if all are at
/// work: there are as many as threads have asked at once.
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Debug for Pool<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pool").finish_non_exhaustive()
    }
}

impl<T> Pool<T> {
    pub(crate) fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Lets a copy work. One that fails is thrown away: nobody knows in which state it is.
    pub(crate) fn with<R>(
        &self,
        start: impl FnOnce() -> Result<T, OdeError>,
        work: impl FnOnce(&mut T) -> Result<R, OdeError>,
    ) -> Result<R, OdeError> {
        let idle = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = idle().pop();
        let mut copy = waiting.map_or_else(start, Ok)?;
        let result = work(&mut copy)?;
        idle().push(copy);
        Ok(result)
    }
}

/// What a program says, or what is wrong with it.
pub(crate) fn external(reason: impl Into<String>) -> OdeError {
    OdeError::External { reason: reason.into() }
}
