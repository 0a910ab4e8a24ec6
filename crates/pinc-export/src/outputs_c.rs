//! Outputs y = h(x, u, p) of a plant, in C.

use crate::equation::{check_constants, jacobian, values};
use crate::open::Open;
use crate::origin::Origin;
use crate::template::Template;
use crate::{ExportError, GeneratedFile, Name};
use pinc_expr::PlantEquations;

/// Header and source of all outputs of `equations`, whose parameters `names` are the model's.
pub(crate) fn outputs_core(
    equations: &PlantEquations,
    names: &[String],
    open: Open<'_>,
    (name, model): (&Name, &'static str),
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (equations, names) = open.equations(equations, names);
    let listing = equations.output_listing(&names)?;
    check_constants("a constant of the plant's outputs", &listing)?;
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("The outputs of a plant.", None))
        .set("MODEL", model)
        .set("NO", listing.results.len())
        .set("VALUES", values(&listing, nx, "y"))
        .set("JACOBIAN", jacobian(&listing, nx, nu + names.len(), "y").body);
    open.set(&mut t);
    Ok(vec![
        t.file("outputs.h", include_str!("../templates/outputs.h")),
        t.file("outputs.c", include_str!("../templates/outputs.c")),
    ])
}
