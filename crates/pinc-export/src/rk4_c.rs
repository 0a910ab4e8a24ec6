//! An integrator of a plant whose equations are text, in C.

use crate::equation::{jacobian, values};
use crate::origin::Origin;
use crate::template::{Template, constant};
use crate::{ExportError, GeneratedFile, Name};
use pinc_expr::Equations;

/// A plant by its equations, integrated by the Runge-Kutta method of order 4.
#[derive(Clone, Copy, Debug)]
pub struct Rk4Model<'a> {
    /// The plant.
    pub equations: &'a Equations,
    /// Length T of a step, in s.
    pub sample_time_s: f64,
    /// Substeps per step.
    pub substeps: usize,
}

/// Header and source of the integrator.
pub(crate) fn rk4_core(
    model: Rk4Model<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let listing = model.equations.listing()?;
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    #[expect(clippy::cast_precision_loss, reason = "substeps are few")]
    let h = model.sample_time_s / model.substeps as f64;
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A plant as its own model, by Runge-Kutta steps.", None))
        .set("REAL", include_str!("../templates/real.h"))
        .set("NX", nx)
        .set("NU", nu)
        .set("T", constant(model.sample_time_s))
        .set("SUBSTEPS", model.substeps)
        .set("H", constant(h))
        .set("VALUES", values(&listing, nx))
        .set("JACOBIAN", jacobian(&listing, nx, nu));
    Ok(vec![
        t.file("rk4.h", include_str!("../templates/rk4.h")),
        t.file("rk4.c", include_str!("../templates/rk4.c")),
    ])
}
