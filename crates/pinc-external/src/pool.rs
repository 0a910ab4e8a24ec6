//! Copies of a simulator, one for each request that runs at the same time.

use pinc_ode::OdeError;
use std::fmt::{self, Debug};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Copies that wait for work. Each thread that asks takes one, or starts a new one if all are at
/// work: there are as many as threads have asked at once.
///
/// Once one has broken what was agreed on, nothing is asked any more: its other answers may be as wrong.
pub(crate) struct Pool<T> {
    idle: Mutex<Vec<T>>,
    broken: OnceLock<OdeError>,
}

/// How the work of a copy failed.
pub(crate) enum Failure {
    /// There is no answer to this request.
    Unanswerable(OdeError),
    /// The simulator did not keep to what was agreed on.
    Broken(OdeError),
}

impl<T> Debug for Pool<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pool").finish_non_exhaustive()
    }
}

impl<T> Pool<T> {
    pub(crate) fn new() -> Self {
        Self { idle: Mutex::new(Vec::new()), broken: OnceLock::new() }
    }

    /// Lets a copy work. One that fails is thrown away: nobody knows in which state it is.
    pub(crate) fn with<R>(
        &self,
        start: impl FnOnce() -> Result<T, Failure>,
        work: impl FnOnce(&mut T) -> Result<R, Failure>,
    ) -> Result<R, OdeError> {
        if let Some(error) = self.broken.get() {
            return Err(error.clone());
        }
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = idle().pop();
        let copy = waiting.map_or_else(start, Ok);
        let done = copy.and_then(|mut copy| work(&mut copy).map(|result| (copy, result)));
        match done {
            Ok((copy, result)) => {
                idle().push(copy);
                Ok(result)
            }
            Err(Failure::Unanswerable(error)) => Err(error),
            Err(Failure::Broken(error)) => Err(self.broken.get_or_init(|| error).clone()),
        }
    }
}

/// [`Failure::Broken`], for this reason.
pub(crate) fn broken(reason: impl Into<String>) -> Failure {
    Failure::Broken(external(reason))
}

/// What a program says, or what is wrong with it.
pub(crate) fn external(reason: impl Into<String>) -> OdeError {
    OdeError::External { reason: reason.into() }
}
