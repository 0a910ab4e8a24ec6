//! The error of the net in each step of a closed loop: estimated, and true.

use crate::RunError;
use crate::control::LoopSetup;
use pinc_net::{PincModel, PincNet};
use pinc_ode::{DynPlant, Model, Simulator};
use pinc_record::{ControlReader, ControlRow, Pair, PairRow, RunDir, StatePairs, file};
use pinc_verify::ErrorEstimate;
use std::path::Path;

/// Local tolerance of the truth.
const TOLERANCE: f64 = 1e-11;

/// A time is a step mark if it is off by less than this share of a step.
const MARK: f64 = 1e-6;

/// Judges `net` at the states and inputs of the loop recorded in `trace`, against the equation of
/// `plant`, and writes the table; nothing for a black box, which has no estimate, or a model whose
/// parameters are estimated, whose equation is not known.
pub(crate) fn write(
    setup: &LoopSetup<'_>,
    net: &PincNet,
    plant: &dyn DynPlant,
    trace: &Path,
    run_dir: &RunDir,
) -> Result<(), RunError> {
    let (true, Ok(estimate)) = (setup.estimated.is_empty(), ErrorEstimate::new(net, plant)) else {
        return Ok(());
    };
    let controlled = &setup.spec.controlled;
    let sizes = [plant.dims().nx, plant.dims().nu];
    let Some(reader) = ControlReader::open(trace, sizes, controlled)? else {
        return Ok(());
    };
    let mut judge = Judge {
        estimate,
        model: PincModel::new(net)?,
        truth: Simulator::new(plant, TOLERANCE),
        parameters: setup.parameters.to_vec(),
    };
    let (mut rows, mut step) = (Vec::new(), 0);
    let mut samples = reader.peekable();
    while let Some(row) = samples.next().transpose()? {
        let mark = step as f64 * setup.sample_time_s;
        // No step begins at the end of the loop.
        if (row.t - mark).abs() > MARK * setup.sample_time_s || samples.peek().is_none() {
            continue;
        }
        if let Some(p) = setup.schedules.model.beginning(step) {
            setup.known.iter().zip(p).for_each(|(&place, p)| judge.parameters[place] = *p);
        }
        rows.push(judge.look(&row, setup.sample_time_s));
        step += 1;
    }
    let table = StatePairs { of: Pair::Errors, states: net.state_names().to_vec(), rows };
    Ok(run_dir.write(file::MODEL_ERROR, table.to_csv().as_bytes())?)
}

struct Judge {
    estimate: ErrorEstimate,
    model: PincModel,
    truth: Simulator,
    parameters: Vec<f64>,
}

impl Judge {
    fn look(&mut self, row: &ControlRow, step_s: f64) -> PairRow {
        let (x, u, p) = (&row.state, &row.input, &self.parameters);
        let (mut estimate, mut next, mut exact) = (x.clone(), x.clone(), x.clone());
        self.estimate.write(x, u, p, &mut estimate);
        self.model.step(x, u, p, &mut next);
        self.truth.set_parameters(p);
        let solved = self.truth.integrate(&mut exact, u, step_s).is_ok();
        let error = next.iter().zip(&exact).map(|(y, z)| if solved { y - z } else { f64::NAN });
        PairRow { t: row.t, values: [estimate, error.collect()] }
    }
}
