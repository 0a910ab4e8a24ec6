//! Loss and gradient of the batched kernel, against the machine's multiply-add peak.

use super::cases::{Case, Effort};
use super::exchange;
use super::results::{FmaPeak, LossGradient};
use pinc_config::Experiment;
use pinc_net::{BatchLoss, Isa, LossWeights, PincNet, Points, Workers, initial_conditions};
use pinc_ode::DynPlant;
use pinc_record::{median, to_f64};
use pinc_runs::clock::{for_seconds, time};
use pinc_runs::{RunError, TrainingSetup};
use std::path::Path;
use std::sync::Barrier;

/// The evaluation that is measured: the paper's net at its initial weights, on the paper's points.
pub(super) struct Evaluation {
    plant: Box<dyn DynPlant>,
    pub(super) net: PincNet,
    pub(super) weights: LossWeights,
    pub(super) collocation: Points,
    pub(super) initial: Points,
}

impl Evaluation {
    fn new(experiment: &Experiment, effort: &Effort) -> Result<Self, RunError> {
        let TrainingSetup { net: model, domain, training, .. } = TrainingSetup::of(experiment)?;
        let seed = experiment.seed;
        let plant = experiment.plant.dyn_plant();
        let net = PincNet::new(plant.as_ref(), model, domain, seed)?;
        let config = &training.config;
        let weights =
            LossWeights::new(&net, config.lambda, &config.residual_scale, config.initial_scale)?;
        let (points, scenarios) = (effort.collocation_points, effort.initial_points);
        Ok(Self {
            plant,
            weights,
            collocation: config.sampler.collocation(
                points,
                model.sample_time_s,
                domain,
                scenarios,
                seed,
            ),
            initial: initial_conditions(scenarios, domain, seed),
            net,
        })
    }

    pub(super) fn batch_loss(&self, workers: &Workers) -> BatchLoss {
        let mut loss = BatchLoss::new(self.plant.as_ref(), &self.net, &self.weights, workers);
        loss.set_points(&self.collocation, &self.initial);
        loss
    }

    /// Floating-point operations that the matrix products need.
    ///
    /// A product with the W weights of the net's matrices takes 2 W operations for each column, and
    /// there are two columns (value and time tangent) for a collocation point and one for an
    /// initial condition. There are three products: forwards; backwards, where the first layer's
    /// (`W_0`) is not needed; and one for the weights' gradient. In total 2 (3 W - `W_0`) a column.
    fn operations(&self) -> u64 {
        let widths = self.net.mlp().widths();
        let weights: usize = widths.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let columns = 2 * self.collocation.len() + self.initial.len();
        (2 * (3 * weights - widths[0] * widths[1]) * columns) as u64
    }
}

/// The measurements of one plant, in every one of `isas`, on one and on all threads. If `file` is
/// given, one evaluation goes there.
pub(super) struct Bench<'a> {
    pub(super) case: Case,
    pub(super) effort: &'a Effort,
    pub(super) isas: &'a [Isa],
    pub(super) file: Option<&'a Path>,
    pub(super) results: &'a mut Vec<LossGradient>,
    pub(super) probes: &'a mut Probes,
}

impl Bench<'_> {
    pub(super) fn run(self) -> Result<(), RunError> {
        let experiment = self.case.papers_training()?;
        let Self { case, effort, isas, file, results, probes } = self;
        let evaluation = Evaluation::new(&experiment, effort)?;
        if let Some(path) = file {
            exchange::write(path, case, &evaluation)?;
        }
        for &isa in isas {
            for threads in thread_counts() {
                let workers = Workers::with_isa(threads, isa)?;
                let measured = Measured::of(&evaluation, &workers, threads, effort);
                results.push(measured.row(case, &evaluation, threads, isa));
                probes.add(threads, measured.peaks);
            }
        }
        Ok(())
    }
}

/// One thread, and all of them.
fn thread_counts() -> Vec<usize> {
    match std::thread::available_parallelism().map_or(1, usize::from) {
        1 => vec![1],
        all => vec![1, all],
    }
}

/// Times of one setting, in s, and what the probe gave in between, in 10^9 operations per second.
struct Measured {
    times: Vec<f64>,
    peaks: Vec<f64>,
}

impl Measured {
    fn of(evaluation: &Evaluation, workers: &Workers, threads: usize, effort: &Effort) -> Self {
        let mut loss = evaluation.batch_loss(workers);
        let parameters = evaluation.net.mlp().parameters();
        let mut gradient = vec![0.0; parameters.len()];
        // The first evaluation finds cold caches and sleeping threads.
        loss.loss_gradient(parameters, &mut gradient);
        let (mut times, mut peaks) = (Vec::new(), Vec::new());
        for_seconds(effort.kernel_s, || {
            peaks.push(probe(threads, effort.probe_rounds));
            times.push(time(|| {
                std::hint::black_box(loss.loss_gradient(parameters, &mut gradient));
            }));
        });
        Self { times, peaks }
    }

    fn row(&self, case: Case, evaluation: &Evaluation, threads: usize, isa: Isa) -> LossGradient {
        let seconds = median(&self.times);
        let gflops = to_f64(evaluation.operations()) / seconds / 1e9;
        LossGradient {
            plant: case.name(),
            layers: size(&evaluation.net),
            points: evaluation.collocation.len() + evaluation.initial.len(),
            initial_points: evaluation.initial.len(),
            precision: "f64",
            threads,
            isa: isa.to_string(),
            ms: 1e3 * seconds,
            gflops,
            fraction_of_peak: gflops / median(&self.peaks),
            repetitions: self.times.len(),
        }
    }
}

/// Hidden layers and neurons of a net, as `4x20`.
pub(super) fn size(net: &PincNet) -> String {
    let widths = net.mlp().widths();
    format!("{}x{}", widths.len() - 2, widths[1])
}

/// What the probes gave, by threads.
#[derive(Default)]
pub(super) struct Probes {
    one: Vec<f64>,
    all: Vec<f64>,
}

impl Probes {
    fn add(&mut self, threads: usize, peaks: Vec<f64>) {
        match threads {
            1 => self.one.extend(peaks),
            _ => self.all.extend(peaks),
        }
    }

    /// The machine's peak; a machine of one thread has the same on all of them.
    pub(super) fn peak(&self) -> FmaPeak {
        let all = if self.all.is_empty() { &self.one } else { &self.all };
        FmaPeak { f64_1: median(&self.one), f64_all: median(all) }
    }
}

/// Multiply-adds of the best instruction set on `threads` threads at once, in 10^9 operations per
/// second.
fn probe(threads: usize, rounds: u64) -> f64 {
    let isa = Isa::detect();
    let start = Barrier::new(threads);
    let work = || {
        start.wait();
        let mut operations = 0;
        let seconds = time(|| operations = isa.multiply_add_rounds(rounds));
        (operations, seconds)
    };
    let shares: Vec<(u64, f64)> = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let own = work();
        let others = others.into_iter().map(|t| t.join().expect("the probe does not panic"));
        std::iter::once(own).chain(others).collect()
    });
    let operations: u64 = shares.iter().map(|share| share.0).sum();
    let seconds = shares.iter().map(|share| share.1).fold(0.0, f64::max);
    to_f64(operations) / seconds / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A product of a weight with a number, and its addition, are two operations. Values and their
    /// derivatives by time take each weight once at a collocation point and its derivative, and once
    /// at an initial point; back each is met twice, but for those of the first layer, beyond which
    /// nothing is to be known.
    #[test]
    fn operations_are_counted_by_layers_and_columns() {
        let experiment = Case::VanDerPol.papers_training().unwrap();
        let effort = Effort { collocation_points: 30, initial_points: 7, ..Effort::new(true) };
        let evaluation = Evaluation::new(&experiment, &effort).unwrap();
        assert_eq!((evaluation.collocation.len(), evaluation.initial.len()), (30, 7));
        let widths = evaluation.net.mlp().widths();
        assert_eq!(widths, [4, 20, 20, 20, 20, 2]);
        let first = 4 * 20;
        let others = 3 * 20 * 20 + 20 * 2;
        let forward_and_back = 2 * (first + others) + 2 * (first + 2 * others);
        assert_eq!(evaluation.operations(), forward_and_back * (2 * 30 + 7));
        assert_eq!(size(&evaluation.net), "4x20");
    }

    /// Each peak is the median of its own measurements; with one thread both are the same.
    #[test]
    fn a_peak_is_of_one_thread_or_of_all() {
        let mut probes = Probes::default();
        probes.add(1, vec![3.0, 1.0, 2.0]);
        assert_eq!(probes.peak(), FmaPeak { f64_1: 2.0, f64_all: 2.0 });
        probes.add(8, vec![20.0]);
        probes.add(1, vec![0.5, 0.25]);
        assert_eq!(probes.peak(), FmaPeak { f64_1: 1.0, f64_all: 20.0 });
    }
}
