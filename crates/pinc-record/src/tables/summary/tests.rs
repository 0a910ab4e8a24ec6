//! Summaries of a sweep.

use super::*;
use crate::metric::tests::run;
use crate::metric::{IAE_DENSE_SUM, MSE_GEN, ONE_STEP_MSE};

/// Three plants, four seeds each: the interval is that of three values, not of twelve.
#[test]
fn seeds_of_one_draw_are_one_value_of_the_interval() {
    let plants = [("1", 10.0), ("2", 30.0), ("3", 20.0)];
    let all =
        plants.iter().flat_map(|(draw, value)| [-3.0, -1.0, 1.0, 2.0].map(|e| (*draw, value + e)));
    let all: Vec<(&str, f64)> = all.collect();
    assert_eq!(independent(&all), [10.0, 30.0, 20.0]);
    let interval = Spread::of(independent(&all)).unwrap().interval_of_median();
    assert_eq!(interval, (10.0, 30.0, 1.0 - 2.0 / 8.0));
    // Seeds alone, or of a single plant, are values of their own.
    assert_eq!(independent(&all[..4]), [7.0, 9.0, 11.0, 12.0]);
}

#[test]
fn a_summary_reads_back_bit_for_bit() {
    let row = SummaryRow {
        cell: vec!["a, \"b\"".to_owned(), "20".to_owned()],
        metric: MSE_GEN.of_net().name(),
        trials: 5,
        failed: 1,
        pending: 1,
        values: 3,
        nonzero: 2,
        min: 0.1 + 0.2,
        q1: 1e-5,
        median: 1e-300,
        q3: 2.0,
        max: 3.0,
        median_low: 0.5,
        median_high: 3.0,
        confidence: 0.75,
    };
    let cell_columns = vec!["case".to_owned(), "model.neurons".to_owned()];
    let table = SummaryTable { cell_columns, rows: vec![row] };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("summary.csv");
    std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
    let read = SummaryTable::read(&path).unwrap().unwrap();
    assert_eq!(read, table);
    assert_eq!(read.choice(&read.rows[0], "model.neurons"), "20");
    assert_eq!(read.of(MSE_GEN.of_net()).count(), 1);
    assert_eq!(read.of(ONE_STEP_MSE.of_net()).count(), 0);
}

/// Two nets, of a seed each, in two plants: the nets count once each, the loops by the trial.
/// A trial that failed, or is not over, has no value, and is counted.
#[test]
fn nets_count_once_and_loops_by_the_trial() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
    let range = "{ key = \"control.initial_state.0\", low = 5.0, high = 6.0 }";
    let draws = format!("sweep.draws=[{{ name = \"start\", count = 2, ranges = [{range}] }}]");
    let sets = ["control.models=[\"rk4\"]".to_owned(), "sweep.seeds=[1, 2]".to_owned(), draws];
    let plants = pinc_config::Plants::built_in();
    let experiment = Experiment::load(path.as_ref(), &sets, &plants).unwrap();
    let trials = config::trials(&experiment).unwrap();
    assert_eq!(trials.len(), 4);
    let sweep = experiment.sweep.as_ref().unwrap();
    let drawn = config::columns(sweep).iter().position(|column| column == DRAW).unwrap();
    // Loops of the first plant have 10 and 30, of the second 20 and 40.
    let loops = |trial: &Trial| {
        let seed = if trial.experiment.seed == 1 { 0.0 } else { 20.0 };
        10.0 * trial.cells[drawn].parse::<f64>().unwrap() + seed
    };
    let first = trials.iter().map(loops).fold(f64::INFINITY, f64::min);
    let mut finished: Vec<Option<Finished>> = trials
        .iter()
        .map(|trial| {
            let mse = 1e-3 * trial.experiment.seed as f64;
            let numbers = [(&MSE_GEN, mse), (&IAE_DENSE_SUM, loops(trial) - first + 10.0)];
            Some(Finished { ending: Ending::Done, metrics: run(&numbers) })
        })
        .collect();
    let table = SummaryTable::new(&experiment, sweep, &trials, &finished);
    let [net] = table.of(MSE_GEN.of_net()).collect::<Vec<_>>()[..] else { panic!("{table:?}") };
    assert_eq!((net.trials, net.values, net.failed, net.pending), (4, 2, 0, 0));
    assert_eq!((net.min.to_bits(), net.max.to_bits()), (1e-3_f64.to_bits(), 2e-3_f64.to_bits()));
    let metric = IAE_DENSE_SUM.with(pinc_config::ModelKind::RK4);
    let row = table.of(metric).next().unwrap();
    let five = [row.min, row.q1, row.median, row.q3, row.max];
    assert_eq!(format!("{five:?}"), "[10.0, 17.5, 25.0, 32.5, 40.0]");
    assert_eq!((row.trials, row.values, row.nonzero), (4, 4, 4));
    // Of the two plants the medians are 20 and 30.
    let interval = [row.median_low, row.median_high, row.confidence];
    assert_eq!(format!("{interval:?}"), "[20.0, 30.0, 0.5]");

    finished[0] = None;
    let lost = finished[1].as_mut().unwrap();
    lost.ending = Ending::Failed { error: "it fell over".to_owned() };
    let table = SummaryTable::new(&experiment, sweep, &trials, &finished);
    let row = table.of(metric).next().unwrap();
    let counts = (row.trials, row.values, row.failed, row.pending);
    assert_eq!(counts, (4, 2, 1, 1));
}
