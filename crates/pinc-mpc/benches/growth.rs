//! How a real-time iteration grows: medians in us by the number of stages N, of states and of
//! inputs, with bounds on the inputs that are active or never reached, by each method for the
//! quadratic programs. `cargo bench -p pinc-mpc --bench growth` prints the rows of a table in
//! Markdown; the method that the automatic choice takes is in bold. A dash is where a smaller N
//! took too long. With `-- --page` it also writes the page docs/growth.md and its picture.
//!
//! The model is a chain of first-order lags with inputs all along it, which costs next to nothing:
//! what is measured is the controller and its quadratic programs.

#![expect(clippy::print_stdout, reason = "the table is what it is for")]

use pinc_chart::{Axis, BLUE, Figure, Kind, Panel, Point, Shape, Style, VERMILLION};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, QpMethod, SqpConfig, Weights};
use pinc_ode::{Dims, Linearization, Model, Stages};
use std::path::Path;
use std::time::Instant;

/// N2 = Nu
const HORIZONS: [usize; 6] = [5, 10, 20, 40, 80, 160];
/// What is compared.
const METHODS: [QpMethod; 2] = [QpMethod::Condensed, QpMethod::Riccati];
/// Numbers of states and inputs.
const SIZES: [[usize; 2]; 7] = [[2, 1], [4, 2], [10, 1], [10, 3], [30, 1], [30, 10], [100, 3]];
/// Steps after which the reference is the other one.
const HELD: usize = 8;
/// Steps of a measurement, after the first one, and how many there are at least.
const STEPS: [usize; 2] = [48, 5];
/// When a measurement ends early, and after which median longer horizons are left out, in s.
const PATIENCE_S: [f64; 2] = [2.0, 0.2];

const INTRODUCTION: &str = "\
# Growth of a control step

Median times in us of a real-time iteration (one linearization of all stages, one QP) by the number
N of stages, of states and of inputs; the automatic choice is bold. The plant is a chain of
first-order lags in a closed loop between two references, with bounds on the inputs that are active
or not reached. The first step of a loop, which has no plan to start from, is not counted.

```sh
cargo bench -p pinc-mpc --bench growth -- --page
```
";

const CHART: &str = "\
![Time of a step over N, one panel for each number of states and inputs: condensed programs are
faster for few stages and grow faster than linearly, the Riccati recursion is linear in N](growth.svg)";

const TABLE: &str = "[Table](tables/growth.csv)";

fn main() {
    let rows: Vec<Row> = SIZES
        .into_iter()
        .flat_map(|size| [false, true].map(|active| (size, active)))
        .flat_map(|(size, active)| METHODS.map(|method| Row::measure(size, active, method)))
        .collect();
    let summary = summary(&rows);
    println!("{summary}");
    if std::env::args().any(|argument| argument == "--page") {
        let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        let svg = figure(&rows).svg().expect("there is something to show");
        std::fs::write(docs.join("growth.svg"), svg).expect("docs/growth.svg can be written");
        let page = page(&summary);
        std::fs::write(docs.join("growth.md"), page).expect("docs/growth.md can be written");
        let table = table(&rows);
        std::fs::write(docs.join("tables/growth.csv"), table).expect("its table can be written");
    }
}

/// The medians of one method at one size, in s.
struct Row {
    size: [usize; 2],
    active: bool,
    method: QpMethod,
    medians: [Option<f64>; HORIZONS.len()],
}

impl Row {
    fn measure(size: [usize; 2], active: bool, method: QpMethod) -> Self {
        let mut patient = true;
        let medians = HORIZONS.map(|horizon| {
            let median = patient.then(|| Loop::new(size, horizon, active, method).median_s());
            patient = median.is_some_and(|median| median < PATIENCE_S[1]);
            median
        });
        let row = Self { size, active, method, medians };
        println!("{}", row.csv());
        row
    }

    fn is_chosen(&self, horizon: usize) -> bool {
        QpMethod::Auto.resolve(self.size, [horizon; 2]) == self.method
    }

    fn csv(&self) -> String {
        let [n, m] = self.size;
        let bounds = if self.active { "active" } else { "not reached" };
        let mut line = format!("{n},{m},{bounds},{}", self.method);
        for (horizon, median) in HORIZONS.into_iter().zip(self.medians) {
            let mark = if self.is_chosen(horizon) { "**" } else { "" };
            line += &match median {
                Some(median) => format!(",{mark}{:.1}{mark}", 1e6 * median),
                None => ",–".to_owned(),
            };
        }
        line
    }
}

/// How much longer than the better method the automatic choice takes.
fn summary(rows: &[Row]) -> String {
    let mut losses = Vec::new();
    for pair in rows.chunks_exact(METHODS.len()) {
        for (i, horizon) in HORIZONS.into_iter().enumerate() {
            let chosen = pair.iter().find(|row| row.is_chosen(horizon));
            let least = pair.iter().filter_map(|row| row.medians[i]).reduce(f64::min);
            if let (Some(chosen), Some(least)) = (chosen.and_then(|row| row.medians[i]), least) {
                losses.push(chosen / least);
            }
        }
    }
    let mean = losses.iter().map(|loss| loss.ln()).sum::<f64>() / losses.len() as f64;
    let most = losses.iter().fold(1.0, |most: f64, loss| most.max(*loss));
    format!(
        "The automatic choice takes {:.2} times as long as the better method in the geometric \
         mean, and {most:.2}\ntimes at most.",
        mean.exp()
    )
}

/// A panel for each size: time over N.
fn figure(rows: &[Row]) -> Figure {
    let x = || {
        let marks = HORIZONS.map(|n| (place(n), n.to_string())).to_vec();
        Axis { marks, ..Axis::new("stages N", Kind::Log) }
    };
    let panels = rows.chunks_exact(2 * METHODS.len()).map(|of_size| {
        let [n, m] = of_size[0].size;
        let title = format!("{n} state{}, {m} input{}", plural(n), plural(m));
        let mut panel = Panel::new(&title, Axis::new("time of a step (us)", Kind::Log), 220.0);
        panel.x = Some(x());
        for row in of_size {
            let color = if row.method == QpMethod::Condensed { BLUE } else { VERMILLION };
            let shape = if row.active { Shape::Line(1.8) } else { Shape::Dashes(1.8) };
            let points = HORIZONS.into_iter().zip(row.medians);
            let points: Vec<Point> =
                points.filter_map(|(n, median)| Some((place(n), 1e6 * median?))).collect();
            let bounds = if row.active { "bounds active" } else { "bounds not reached" };
            panel.add_named(&format!("{}, {bounds}", row.method), points, Style::new(color, shape));
        }
        panel
    });
    let name = "Time of a control step over the number of stages, condensed and stage by stage";
    Figure::grid(name, x(), vec![1.0, 1.0], panels.collect())
}

fn place(horizon: usize) -> f64 {
    horizon as f64
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

fn page(summary: &str) -> String {
    let processor = processor();
    format!("{INTRODUCTION}\n{summary}\n\nProcessor: {processor}.\n\n{CHART}\n\n{TABLE}\n")
}

fn table(rows: &[Row]) -> String {
    let horizons = HORIZONS.map(|n| n.to_string()).join(",");
    let lines: String = rows.iter().map(|row| row.csv() + "\n").collect();
    format!("states,inputs,bounds,method,{horizons}\n{lines}")
}

/// The processor's name, where the system tells it.
fn processor() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name"));
    name.map_or("unknown", |name| name.trim_start_matches(['\t', ' ', ':'])).to_owned()
}

/// `x_i <- x_i + (x_{i-1} - x_i) / 8 + inputs / 4`, input k at states k, k + m, ..
#[derive(Debug)]
struct Lags {
    dims: Dims,
}

impl Lags {
    fn a(row: usize, column: usize) -> f64 {
        match row.checked_sub(column) {
            Some(0) => 0.875,
            Some(1) => 0.125,
            _ => 0.0,
        }
    }

    fn b(&self, row: usize, column: usize) -> f64 {
        if row % self.dims.nu == column { 0.25 } else { 0.0 }
    }
}

impl Model for Lags {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        for (row, next) in next.iter_mut().enumerate() {
            let before = if row > 0 { x[row - 1] } else { 0.0 };
            *next = 0.875 * x[row] + 0.125 * before + 0.25 * u[row % self.dims.nu];
        }
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let Dims { nx, nu, .. } = self.dims;
        for k in 0..at.count(self.dims) {
            let (at, out) = (at.point(k, self.dims), out.point(k, self.dims));
            self.step(at.x, at.u, at.p, out.next);
            let places = |width: usize| (0..nx).flat_map(move |r| (0..width).map(move |c| (r, c)));
            out.a.iter_mut().zip(places(nx)).for_each(|(a, (r, c))| *a = Self::a(r, c));
            out.b.iter_mut().zip(places(nu)).for_each(|(b, (r, c))| *b = self.b(r, c));
        }
    }
}

/// A closed loop between two references.
struct Loop {
    nmpc: Nmpc,
    plant: Lags,
    references: [Vec<f64>; 2],
}

impl Loop {
    /// Q = 10 I, R = I, all states are controlled. The references need inputs of 1; bounds of 0.75
    /// are active, bounds of 100 never.
    fn new([n, m]: [usize; 2], horizon: usize, active: bool, qp: QpMethod) -> Self {
        let dims = Dims::new(n, m);
        let bound = if active { 0.75 } else { 100.0 };
        let weights = Weights::uniform(vec![10.0; n], vec![1.0; m]);
        let problem = NmpcProblem {
            input_bounds: Bounds { low: vec![-bound; m], high: vec![bound; m] },
            ..NmpcProblem::new(dims, horizon, weights)
        };
        let config = SqpConfig { qp, real_time: true, ..SqpConfig::default() };
        let nmpc = Nmpc::new(problem, Box::new(Lags { dims }), config).expect("a valid problem");
        let mut rest = vec![0.0; n];
        for row in 0..n {
            rest[row] = if row > 0 { rest[row - 1] } else { 0.0 } + 2.0;
        }
        let references = [1.0, -1.0].map(|sign| {
            let at_rest: Vec<f64> = rest.iter().map(|x| sign * x).collect();
            at_rest.repeat(horizon)
        });
        Self { nmpc, plant: Lags { dims }, references }
    }

    fn median_s(&mut self) -> f64 {
        let n = self.plant.dims.nx;
        let (mut x, mut next) = (vec![0.0; n], vec![0.0; n]);
        let mut times = Vec::with_capacity(STEPS[0]);
        let begin = Instant::now();
        for k in 0..=STEPS[0] {
            let reference = &self.references[k / HELD % 2];
            let clock = Instant::now();
            let step = self.nmpc.step(&x, reference).expect("numbers of the right shape");
            if k > 0 {
                times.push(clock.elapsed().as_secs_f64());
            }
            self.plant.step(&x, step.u, &[], &mut next);
            std::mem::swap(&mut x, &mut next);
            if times.len() >= STEPS[1] && begin.elapsed().as_secs_f64() > PATIENCE_S[0] {
                break;
            }
        }
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    }
}
