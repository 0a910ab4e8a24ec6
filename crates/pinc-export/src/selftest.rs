//! What the numbers of a controller's self-test may differ by.

use crate::ExportError;
use crate::controller::Controller;
use crate::feedback_c::Filter;
use crate::template::{Template, constant};
use pinc_estimate::Compensated;
use pinc_mpc::{Nmpc, SqpConfig, SqpHessian, SqpStatus};
use std::fmt::Write as _;

/// The smallest residual that single precision can be asked for.
pub(crate) const FLOAT_TOLERANCE: f64 = 1e-3;

/// How much more than by rounding and residual alone a number may be off.
const MARGIN: f64 = 4.0;

/// What one precision makes of numbers, relative to their unit plus their size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Precision {
    /// The relative error of what is measured that stands for rounding.
    pub(crate) rounding: f64,
    /// What a number may differ by in any case.
    tolerance: f64,
    /// A number that rounding and residual move by more is not compared.
    most: f64,
}

impl Precision {
    /// Double and single precision. With the unscented filter numbers are not compared closer: its points
    /// are close together in double, which leaves rounding, and far apart in float, which makes another
    /// filter.
    pub(crate) fn both(filter: Option<Filter>) -> [Self; 2] {
        let [double, float] = match filter {
            None | Some(Filter::Extended | Filter::MovingHorizon(_)) => [1e-8, 1e-3],
            Some(Filter::Unscented) => [1e-6, 5e-2],
        };
        [
            Self { rounding: 1e-13, tolerance: double, most: double },
            Self { rounding: 1e-6, tolerance: float, most: 5e-2 },
        ]
    }

    /// The numbers of row `k` with errors that stand for rounding.
    pub(crate) fn round(self, k: usize, row: &[f64]) -> Vec<f64> {
        let sign =
            |i: usize| if (i + k).is_multiple_of(2) { self.rounding } else { -self.rounding };
        row.iter().enumerate().map(|(i, x)| x * (1.0 + sign(i))).collect()
    }

    /// What the numbers of each step may differ by, from how far rounding and residual move them, up to
    /// the first step in which that is too far.
    fn allowed(self, moved: &[f64]) -> Vec<f64> {
        let so_far = moved.iter().scan(0.0_f64, |most, &moved| {
            *most = if moved <= *most { *most } else { moved };
            Some(*most)
        });
        let compared = so_far.take_while(|moved| *moved <= self.most);
        compared.map(|moved| (MARGIN * moved).clamp(self.tolerance, self.most)).collect()
    }
}

/// The largest difference of two rows, relative to a number's unit plus the size of that of `expected`.
pub(crate) fn difference<'a>(
    found: impl IntoIterator<Item = &'a f64>,
    expected: impl IntoIterator<Item = &'a f64>,
    units: &[f64],
) -> f64 {
    let off = |((a, b), unit): ((&f64, &f64), &f64)| (a - b).abs() / (unit + b.abs());
    let all = found.into_iter().zip(expected).zip(units).map(off);
    all.fold(0.0, |most, off| if off <= most { most } else { off })
}

/// Whether a step of the Gauss-Newton Hessian alone may have found no plan that the exact one finds.
pub(crate) fn is_unsolved(status: SqpStatus) -> bool {
    matches!(status, SqpStatus::IterationLimit | SqpStatus::Stalled)
}

/// Refuses a loop whose step `k` leads from the state `x` and the input `u` to values that are not
/// finite.
pub(crate) fn check_step<'a>(
    controller: &Controller<'_>,
    (k, x, u): (usize, &[f64], &[f64]),
    values: impl IntoIterator<Item = &'a f64>,
) -> Result<(), ExportError> {
    match values.into_iter().all(|value| value.is_finite()) {
        true => Ok(()),
        false => Err(ExportError::NoValue {
            t: k as f64 * controller.sample_time_s(),
            x: x.to_vec(),
            u: u.to_vec(),
        }),
    }
}

/// The controller of the library as it ends its iteration in single precision; `None` where it is more
/// than an optimization.
pub(crate) fn in_float(controller: &Controller<'_>) -> Result<Option<Nmpc>, ExportError> {
    if controller.guard.is_some() || controller.tube.is_some() {
        return Ok(None);
    }
    let mut model = controller.library_model()?;
    let first = controller.first_input(model.dims());
    if let Some(of) = controller.estimator {
        model = Box::new(Compensated::new(model, of.augmentation.clone())?);
    }
    let tolerance = controller.config.tolerance.max(FLOAT_TOLERANCE);
    let hessian = SqpHessian::GaussNewton;
    let config = SqpConfig { tolerance, hessian, ..*controller.config };
    let mut nmpc = Nmpc::new(controller.problem.clone(), model, config)?;
    nmpc.reset_input(&first)?;
    Ok(Some(nmpc))
}

/// Fills what the self-test compares, by how far double and single precision move its steps.
pub(crate) fn set_allowed(t: &mut Template, filter: Option<Filter>, moved: [&[f64]; 2]) {
    let [double, float] = Precision::both(filter);
    let [double, float] = [double.allowed(moved[0]), float.allowed(moved[1])];
    let steps = moved[1].len();
    let mut text = format!("static const double pinc_allowed_float[{}] = {{\n", steps.max(1));
    let rows: Vec<String> = float.iter().map(|allowed| format!("{allowed:.1e}")).collect();
    let missing = vec!["0.0".to_owned(); steps.max(1) - rows.len()];
    for row in [rows, missing].concat().chunks(8) {
        let _ = writeln!(text, "    {},", row.join(", "));
    }
    text += "};\n";
    let [of_double, of_float] = Precision::both(filter).map(|of| of.tolerance);
    t.set("ALLOWED", text).set("DOUBLE", constant(of_double));
    t.set("FLOAT", format!("{:.1e}", float.last().unwrap_or(&of_float)));
    t.set("FLOAT_STEPS", float.len()).set("DOUBLE_STEPS", double.len());
}
