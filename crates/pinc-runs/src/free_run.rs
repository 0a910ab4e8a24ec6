//! The free run of a trained net against the truth, for the report.

use super::chain::Chain;
use super::guard::Guard;
use crate::RunError;
use pinc_config::{OutsidePolicy, PredictionSpec};
use pinc_net::{PincNet, TrainingTarget};
use pinc_ode::metrics::mean_squared_error;
use pinc_ode::{DynPlant, Simulator};
use pinc_record::{PredictionMetrics, PredictionRow, PredictionTable, RunDir, file};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// The stream of random numbers that the inputs are drawn from; pinc-net's are below.
const STREAM: u64 = 1 << 32;

/// Runs net and plant under the same random inputs, or a conventional PINN beside its one scenario,
/// and writes `prediction.csv`. `p` are the parameters of the plant that the net takes as inputs.
pub(crate) fn stage(
    plant: &dyn DynPlant,
    net: &PincNet,
    (spec, p): (&PredictionSpec, &[f64]),
    seed: u64,
    run_dir: &mut RunDir,
) -> Result<(), RunError> {
    let rows = simulate(plant, net, (spec, p), seed)?;
    let (inputs, states) = (net.input_names().to_vec(), net.state_names().to_vec());
    let table = PredictionTable { inputs, states, rows };
    run_dir.write(file::PREDICTION, table.to_csv().as_bytes())?;
    let rows = &table.rows;
    // The initial state is given, not predicted.
    let marks: Vec<_> = rows[1..].iter().filter(|row| row.mark).collect();
    let all: Vec<_> = rows[1..].iter().collect();
    let mut guard = Guard::of_command(net, OutsidePolicy::Report);
    if net.time_only().is_none() {
        rows.iter()
            .filter(|row| row.mark)
            .try_for_each(|row| guard.look(&row.state, &row.input, p))?;
    }
    let outside_domain = Some(guard.found()).filter(|found| found.samples > 0);
    let metrics =
        PredictionMetrics { mse_marks: error(&marks), mse_all: error(&all), outside_domain };
    run_dir.note(&[file::PREDICTION]);
    Ok(run_dir.update(|all| all.prediction = Some(metrics))?)
}

fn simulate(
    plant: &dyn DynPlant,
    net: &PincNet,
    (spec, p): (&PredictionSpec, &[f64]),
    seed: u64,
) -> Result<Vec<PredictionRow>, RunError> {
    let sample_time_s = net.sample_time_s();
    // A distilled net is not defined between steps.
    let subintervals = match net.source() {
        TrainingTarget::Physics => spec.subintervals,
        TrainingTarget::Integrator => 1,
    };
    let inputs = draw_inputs(spec, sample_time_s, seed);
    let steps = inputs.len();
    let mut truth = Simulator::new(plant, spec.tolerance);
    let mut x = spec.initial_state.clone();
    let mut chain = Chain::new(sample_time_s, 0.0, &x, &inputs[0]);
    let mut rows = vec![PredictionRow {
        t: 0.0,
        input: inputs[0].clone(),
        state: x.clone(),
        truth: x.clone(),
        mark: true,
    }];
    for (k, input) in inputs.iter().enumerate() {
        for i in 1..=subintervals {
            let t = (k as f64 + i as f64 / subintervals as f64) * sample_time_s;
            truth.integrate(&mut x, input, sample_time_s / subintervals as f64)?;
            let held = if i < subintervals { input } else { &inputs[(k + 1).min(steps - 1)] };
            let (state, mark) = match net.time_only() {
                // It has no initial state to be fed back: beyond T it is asked for what it never learnt.
                Some(_) => (net.evaluate(t, &spec.initial_state, input, p), i == subintervals),
                None => {
                    let mut step = |t, y0: &[f64], u: &[f64]| net.evaluate(t, y0, u, p);
                    let sample = chain.advance(&mut step, t, held);
                    (sample.state, sample.mark)
                }
            };
            rows.push(PredictionRow { t, input: held.clone(), state, truth: x.clone(), mark });
        }
    }
    Ok(rows)
}

/// One input for each T, uniform between its bounds.
fn draw_inputs(spec: &PredictionSpec, sample_time_s: f64, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(STREAM);
    let steps = pinc_config::steps(spec.duration_s, sample_time_s);
    let mut draw = || {
        let ends = spec.input_low.iter().zip(&spec.input_high);
        ends.map(|(low, high)| low + (high - low) * rng.random::<f64>()).collect()
    };
    (0..steps).map(|_| draw()).collect()
}

fn error(rows: &[&PredictionRow]) -> f64 {
    let predicted: Vec<f64> = rows.iter().flat_map(|row| &row.state).copied().collect();
    let truth: Vec<f64> = rows.iter().flat_map(|row| &row.truth).copied().collect();
    mean_squared_error(&predicted, &truth, &vec![1.0; rows[0].state.len()])
}
