//! Memory is allocated when a training begins, not while it runs.
#![expect(unsafe_code, reason = "an allocator that counts must implement an unsafe trait")]

use pinc_net::optim::{
    Iterate, LbfgsConfig, LeastSquares, LineSearch, Objective, Optimizer, OptimizerConfig, Outcome,
    SelfScaledBroydenConfig,
};
use pinc_net::{
    Ansatz, BatchLoss, Domain, InitialScale, LossWeights, NetConfig, PincNet, ResidualScale,
    Sampler, Workers, initial_conditions,
};
use pinc_plants::VanDerPol;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, with a count of all threads' requests.
struct Counting;

static REQUESTS: AtomicUsize = AtomicUsize::new(0);
static BYTES: AtomicUsize = AtomicUsize::new(0);

fn count(bytes: usize) {
    REQUESTS.fetch_add(1, Ordering::Relaxed);
    BYTES.fetch_add(bytes, Ordering::Relaxed);
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.dealloc(memory, layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Requests and bytes during `work`.
fn allocated(work: impl FnOnce()) -> (usize, usize) {
    let before = (REQUESTS.load(Ordering::Relaxed), BYTES.load(Ordering::Relaxed));
    work();
    let after = (REQUESTS.load(Ordering::Relaxed), BYTES.load(Ordering::Relaxed));
    (after.0 - before.0, after.1 - before.1)
}

/// Rosenbrock's function: its minimum is far enough for any optimizer.
struct Rosenbrock;

impl Objective for Rosenbrock {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let mut value = 0.0;
        for i in 0..x.len() - 1 {
            let (a, b) = (1.0 - x[i], x[i + 1] - x[i] * x[i]);
            value += a * a + 100.0 * b * b;
            gradient[i] += -2.0 * a - 400.0 * b * x[i];
            gradient[i + 1] += 200.0 * b;
        }
        value
    }
}

impl LeastSquares for Rosenbrock {
    fn normal_matrix(&mut self, _: &[f64], _: &mut [f64]) {
        panic!("not asked for by these optimizers");
    }
}

/// What iterations 31 to 130 allocate: by then all memories are full.
fn optimizer(config: &OptimizerConfig, workers: &Workers) -> (usize, usize) {
    let variables = 200;
    let mut optimizer = Optimizer::new(config, variables);
    let mut at = Iterate::new(&mut Rosenbrock, vec![-1.2; variables]);
    let mut iterate = |iterations| {
        for _ in 0..iterations {
            assert_eq!(optimizer.step(&mut Rosenbrock, &mut at, workers), Outcome::Moved);
        }
    };
    iterate(30);
    allocated(|| iterate(100))
}

/// What 100 evaluations of a loss and its gradient allocate, after the first.
fn loss(points: usize, neurons: usize, workers: &Workers) -> (usize, usize) {
    let plant = VanDerPol::default();
    let domain = Domain {
        state_low: vec![-3.0; 2],
        state_high: vec![3.0; 2],
        input_low: vec![-1.0],
        input_high: vec![1.0],
        parameters: Vec::new(),
    };
    let (sample_time_s, ansatz) = (0.5, Ansatz::Direct);
    let config = NetConfig { sample_time_s, hidden_layers: 2, neurons, ansatz, time_only: None };
    let net = PincNet::new(&plant, &config, &domain, 1).unwrap();
    let (scale, initial) = (ResidualScale::Normalized, InitialScale::Normalized);
    let weights = LossWeights::new(&net, 1.0, &scale, initial).unwrap();
    let mut loss = BatchLoss::new(&plant, &net, &weights, workers);
    let collocation = Sampler::Sobol.collocation(points, sample_time_s, &domain, 1, 1);
    loss.set_points(&collocation, &initial_conditions(50, &domain, 1));
    let mut gradient = vec![0.0; net.mlp().parameters().len()];
    loss.loss_gradient(net.mlp().parameters(), &mut gradient);
    allocated(|| {
        for _ in 0..100 {
            loss.loss_gradient(net.mlp().parameters(), &mut gradient);
        }
    })
}

// One test, because the counts are of the whole process; and threads that live until its end,
// because they allocate when they begin and end.
#[test]
fn iterations_do_not_allocate() {
    let (one, two) = (Workers::new(1).unwrap(), Workers::new(2).unwrap());
    // To hand a job to a pool of threads, rayon appends it to a list of blocks of some 60 jobs (1.5
    // KB each): one block in 60 iterations. The matrix alone would be 160 KB, a vector 1.6 KB.
    let config = SelfScaledBroydenConfig { initial_step: 0.1, gradient_tolerance: 0.0 };
    let (requests, bytes) = optimizer(&OptimizerConfig::SelfScaledBroyden(config), &one);
    assert!(requests <= 4 && bytes <= 8000, "{requests} requests, {bytes} bytes");
    // A broadcast to the threads allocates its jobs, in one request of some tens of bytes per
    // thread, whatever the sizes; rayon's lists of jobs may grow now and then.
    for (points, neurons, workers) in [(200, 4, &one), (5000, 20, &one), (5000, 20, &two)] {
        let (requests, bytes) = loss(points, neurons, workers);
        let sizes = format!("{points} points, {neurons} neurons");
        assert!(requests <= 110 && bytes <= 20_000, "{sizes}: {requests} requests, {bytes} bytes");
    }
    // This method works on the caller's thread.
    for line_search in [LineSearch::WeakWolfe, LineSearch::HagerZhang] {
        let config = LbfgsConfig { memory: 10, line_search, gradient_tolerance: 0.0 };
        assert_eq!(optimizer(&OptimizerConfig::Lbfgs(config), &one), (0, 0), "{line_search:?}");
    }
}
