//! What cannot be exported.

use pinc_net::NetError;
use thiserror::Error;

/// An error of this crate.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ExportError {
    /// A name that cannot begin the names in a program.
    #[error(
        "name: `{found}` given, expected a letter, then letters, digits and underscores, at most \
        31 in all, and no word of C"
    )]
    Name {
        /// The name.
        found: String,
    },
    /// A net that is no model.
    #[error(transparent)]
    Net(#[from] NetError),
}
