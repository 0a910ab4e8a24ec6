//! Nets and controllers as sources and files of other programs.
//!
//! - [`net_to_c`]: a net as C99 without dependencies.
//!
//! All of these give the content of files, [`GeneratedFile`]; writing them is up to the caller.

mod error;
mod golden;
mod name;
mod net_c;
mod origin;
mod template;

pub use error::ExportError;
pub use name::Name;
pub use net_c::net_to_c;
pub use origin::Origin;

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeneratedFile {
    /// Its path below the directory of the export, with slashes.
    pub path: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl GeneratedFile {
    /// A file of text.
    pub(crate) fn text(path: String, text: String) -> Self {
        Self { path, bytes: text.into_bytes() }
    }
}
