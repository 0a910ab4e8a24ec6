//! An integrator of a plant, in C.

use crate::equation::{check_constants, jacobian, values};
use crate::open::Open;
use crate::origin::Origin;
use crate::template::{Template, constant, numbers};
use crate::{ExportError, GeneratedFile, Name};
use pinc_expr::PlantEquations;
use pinc_ode::{DynPlant, Model, Tableau};

/// A plant by its equations, integrated by a Runge-Kutta method.
#[derive(Clone, Copy, Debug)]
pub struct RungeKuttaModel<'a> {
    /// The plant.
    pub equations: &'a PlantEquations,
    /// The parameters that are arguments p of the model, by their names; the values of the others
    /// are those of the equations.
    pub parameters: &'a [String],
    /// The method.
    pub method: ExplicitMethod,
    /// Length T of a step, in s.
    pub sample_time_s: f64,
    /// Substeps per step.
    pub substeps: usize,
}

/// The explicit Runge-Kutta methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExplicitMethod {
    /// The classical one, of order 4.
    Rk4,
    /// That of Dormand and Prince, of order 5.
    Rk5,
}

impl ExplicitMethod {
    /// What files and functions are named after.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Rk4 => "rk4",
            Self::Rk5 => "rk5",
        }
    }

    /// Its order, as pages give it.
    pub(crate) fn order(self) -> u8 {
        match self {
            Self::Rk4 => 4,
            Self::Rk5 => 5,
        }
    }

    fn tableau(self) -> Tableau {
        match self {
            Self::Rk4 => Tableau::CLASSICAL,
            Self::Rk5 => Tableau::DORMAND_PRINCE,
        }
    }
}

impl RungeKuttaModel<'_> {
    /// The plant, as the library has it.
    pub(crate) fn plant(&self) -> Result<Box<dyn DynPlant>, ExportError> {
        let names: Vec<&str> = self.parameters.iter().map(String::as_str).collect();
        Ok(self.equations.compile_with(&names)?.into_dyn())
    }

    /// The model, as the library has it.
    pub(crate) fn library(&self) -> Result<Box<dyn Model>, ExportError> {
        let plant = self.plant()?;
        Ok(match self.method {
            ExplicitMethod::Rk4 => plant.rk4(self.sample_time_s, self.substeps),
            ExplicitMethod::Rk5 => plant.rk5(self.sample_time_s, self.substeps),
        })
    }
}

/// Header and source of the integrator, with the parameters that `open` names behind the inputs.
pub(crate) fn runge_kutta_core(
    model: RungeKuttaModel<'_>,
    open: Open<'_>,
    name: &Name,
    origin: &Origin,
) -> Result<Vec<GeneratedFile>, ExportError> {
    let (equations, names) = open.equations(model.equations, model.parameters);
    let listing = equations.listing(&names)?;
    check_constants("a constant of the plant's equations", &listing)?;
    let (nx, nu) = (origin.states.len(), origin.inputs.len());
    let rows = model.method.tableau().rows();
    let stages = rows.len() - 1;
    let mut tableau = Vec::new();
    for row in rows {
        tableau.extend_from_slice(row);
        tableau.resize(tableau.len() + stages - row.len(), 0.0);
    }
    #[expect(clippy::cast_precision_loss, reason = "substeps are few")]
    let h = model.sample_time_s / model.substeps as f64;
    let mut t = Template::new(name);
    t.set("BANNER", origin.banner("A plant as its own model, by Runge-Kutta steps.", None))
        .set("REAL", include_str!("../templates/real.h"))
        .set("RK", model.method.name())
        .set("NX", nx)
        .set("NU", nu)
        .set("T", constant(model.sample_time_s))
        .set("SUBSTEPS", model.substeps)
        .set("H", constant(h))
        .set("STAGES", stages)
        .set("TABLEAU", numbers(&tableau))
        .set("VALUES", values(&listing, nx, "dx"))
        .set("JACOBIAN", jacobian(&listing, nx, nu + names.len(), "dx"));
    open.set(&mut t);
    let file = |suffix: &str| format!("{}.{suffix}", model.method.name());
    Ok(vec![
        t.file(&file("h"), include_str!("../templates/runge_kutta.h")),
        t.file(&file("c"), include_str!("../templates/runge_kutta.c")),
    ])
}
