//! Recorded data, and the plants they come from.

use pinc_ad::Scalar;
use pinc_estimate::{Augmentation, Augmented, Estimator, Measured, Tuning};
use pinc_ode::{Model, Plant, Rk4, Variable};
use pinc_plants::{FourTanks, VanDerPol};
use std::path::Path;

/// A table of numbers with names.
pub(crate) struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// A file of `tests/data`. See the README there for where they come from.
    pub(crate) fn read(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
        Self { names, rows: lines.map(row).collect() }
    }

    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Some entries of a row, by their names.
    pub(crate) fn at(&self, row: usize, names: &[&str]) -> Vec<f64> {
        let place = |name: &&str| self.names.iter().position(|n| n == name).unwrap();
        names.iter().map(|name| self.rows[row][place(name)]).collect()
    }
}

/// Two species in a batch reactor, of which the total pressure is measured: pA' = -2 k pA^2, pB' =
/// k pA^2; after Haseltine and Rawlings (2003). There is no input: the one that a model must have
/// does nothing.
#[derive(Clone, Debug)]
pub(crate) struct Batch;

impl Plant for Batch {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("pA", ""), Variable::new("pB", "")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("none", "")];
        &INPUTS
    }
    fn outputs(&self) -> &[Variable] {
        static OUTPUTS: [Variable; 1] = [Variable::new("total", "")];
        &OUTPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], dx: &mut [S]) {
        let rate = x[0] * x[0] * 0.16;
        dx[0] = rate * -2.0;
        dx[1] = rate;
    }
    fn output<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[0] + x[1];
    }
}

/// Recorded data with what an estimator is told.
pub(crate) struct Case {
    pub(crate) data: Table,
    pub(crate) inputs: &'static [&'static str],
    pub(crate) measured: &'static [&'static str],
    pub(crate) states: &'static [&'static str],
    pub(crate) tuning: Tuning,
    model: fn() -> Box<dyn Model>,
    augmentation: Augmentation,
}

impl Case {
    pub(crate) fn model(&self) -> Box<dyn Model> {
        Box::new(Augmented::new((self.model)(), self.augmentation.clone()).unwrap())
    }

    /// The filtered estimates and their standard deviations, one pair per row of the data.
    pub(crate) fn run(&self, estimator: &mut dyn Estimator) -> Vec<(Vec<f64>, Vec<f64>)> {
        let mut found = Vec::new();
        for k in 0..self.data.len() {
            estimator.correct(&self.data.at(k, self.measured));
            let n = estimator.estimate().len();
            let sd = |i: usize| estimator.covariance()[i * (n + 1)].sqrt();
            found.push((estimator.estimate().to_vec(), (0..n).map(sd).collect()));
            let u = if self.inputs.is_empty() { vec![0.0] } else { self.data.at(k, self.inputs) };
            estimator.predict(&u);
        }
        found
    }

    /// The root mean square errors of the estimates from row 20 on.
    pub(crate) fn rmse(&self, found: &[(Vec<f64>, Vec<f64>)]) -> Vec<f64> {
        let mut sums = vec![0.0; self.states.len()];
        for (k, (estimate, _)) in found.iter().enumerate().skip(20) {
            let truth = self.data.at(k, self.states);
            for (sum, (estimate, truth)) in sums.iter_mut().zip(estimate.iter().zip(truth)) {
                *sum += (estimate - truth).powi(2);
            }
        }
        let count = f64::from(u32::try_from(found.len() - 20).unwrap());
        sums.into_iter().map(|sum| (sum / count).sqrt()).collect()
    }
}

pub(crate) fn tanks() -> Case {
    Case {
        data: Table::read("estim-tanks.csv"),
        inputs: &["u1", "u2"],
        measured: &["y_h1", "y_h2"],
        states: &["h1", "h2", "h3", "h4"],
        tuning: Tuning {
            initial_estimate: vec![8.0, 13.0, 3.5, 2.5],
            initial_sd: vec![1.0; 4],
            process_sd: vec![0.03; 4],
            measurement_sd: vec![0.05; 2],
            ..Tuning::default()
        },
        model: || Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4)),
        augmentation: Augmentation::measured(Measured::states([0, 1])),
    }
}

pub(crate) fn oscillator() -> Case {
    Case {
        data: Table::read("estim-vdp.csv"),
        inputs: &["u"],
        measured: &["y_x1"],
        states: &["x1", "x2"],
        tuning: Tuning {
            initial_estimate: vec![0.0; 2],
            initial_sd: vec![1.0; 2],
            process_sd: vec![0.02; 2],
            measurement_sd: vec![0.1],
            ..Tuning::default()
        },
        model: || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)),
        augmentation: Augmentation::measured(Measured::states([0])),
    }
}

pub(crate) fn batch() -> Case {
    Case {
        data: Table::read("estim-batch.csv"),
        inputs: &[],
        measured: &["y_total"],
        states: &["pA", "pB"],
        tuning: Tuning {
            initial_estimate: vec![0.1, 4.5],
            initial_sd: vec![6.0; 2],
            process_sd: vec![0.001; 2],
            measurement_sd: vec![0.1],
            ..Tuning::default()
        },
        model: || Box::new(Rk4::new(Batch, 0.1, 4)),
        augmentation: Augmentation::measured(vec![Measured::Output(0)]),
    }
}

/// The largest difference between `found` and a file of answers, whose first row belongs to the
/// first estimate.
pub(crate) fn distance(
    found: &[(Vec<f64>, Vec<f64>)],
    answer: &str,
    states: &[&str],
    with_sd: bool,
) -> f64 {
    let answer = Table::read(answer);
    assert_eq!(answer.len(), found.len());
    let names: Vec<_> = states.iter().map(|name| format!("sd_{name}")).collect();
    let sd_names: Vec<_> = names.iter().map(String::as_str).collect();
    let mut worst = 0.0_f64;
    for (k, (estimate, sd)) in found.iter().enumerate() {
        let expected = answer.at(k, states);
        let pairs = estimate.iter().zip(expected);
        worst = pairs.map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        if with_sd {
            let pairs = sd.iter().zip(answer.at(k, &sd_names));
            worst = pairs.map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        }
    }
    worst
}
