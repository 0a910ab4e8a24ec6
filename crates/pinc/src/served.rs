//! `pinc serve`.

use pinc_config::{Experiment, ModelKind};
use pinc_runs::{RunError, console};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;

/// How a controller is served.
pub(crate) struct Served<'a> {
    pub(crate) model: Option<&'a Path>,
    pub(crate) only: Option<ModelKind>,
    pub(crate) listen: Option<SocketAddr>,
}

impl Served<'_> {
    /// Serves the clients of a port, or standard input until it ends.
    pub(crate) fn serve(&self, experiment: &Experiment, quiet: bool) -> Result<(), RunError> {
        let Self { model, only, listen } = *self;
        let (input, output) = (std::io::stdin().lock(), std::io::stdout().lock());
        if let Some(address) = listen {
            let listener = TcpListener::bind(address)
                .map_err(|error| RunError::usage("`--listen`", format!("{address}: {error}")))?;
            match pinc_serve::serve_clients(experiment, model, only, &listener, output)? {}
        }
        let found = pinc_serve::serve(experiment, model, only, input, output)?;
        if found.outside > 0 && !quiet {
            console::note(&format!("warning: {found}"));
        }
        Ok(())
    }
}
