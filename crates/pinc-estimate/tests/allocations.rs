//! A step of an estimator allocates nothing, however it ends.
#![expect(unsafe_code, reason = "an allocator that counts must implement an unsafe trait")]

use pinc_estimate::{
    Augmentation, Augmented, Compensated, Disturbance, Ekf, Estimator, Measured, Mhe, Tuning, Ukf,
};
use pinc_ode::{LinearizationBuffer, Model, Rk4, Stages};
use pinc_plants::FourTanks;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator, with a count of each thread's requests: the test runner's own threads
/// allocate when they please.
struct Counting;

thread_local! {
    static REQUESTS: Cell<usize> = const { Cell::new(0) };
}

fn requests() -> usize {
    REQUESTS.with(Cell::get)
}

fn count() {
    REQUESTS.with(|requests| requests.set(requests.get() + 1));
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.dealloc(memory, layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn augmentation(disturbance: Disturbance) -> Augmentation {
    Augmentation { disturbance, ..Augmentation::measured(Measured::states([0, 1])) }
}

fn tanks() -> Box<dyn Model> {
    Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4))
}

fn disturbances() -> [Disturbance; 4] {
    [Disturbance::None, Disturbance::Input, Disturbance::Output, Disturbance::States(vec![0, 1])]
}

fn estimators(disturbance: &Disturbance) -> Vec<Box<dyn Estimator>> {
    let model = || Box::new(Augmented::new(tanks(), augmentation(disturbance.clone())).unwrap());
    let n = model().dims().nx;
    let tuning = Tuning {
        initial_estimate: [vec![8.0, 13.0, 3.5, 2.5], vec![0.0; n - 4]].concat(),
        initial_sd: vec![0.5; n],
        process_sd: vec![0.02; n],
        measurement_sd: vec![0.05; 2],
        low: vec![-20.0; n],
        high: vec![20.0; n],
        ..Tuning::default()
    };
    vec![
        Box::new(Ekf::new(model(), tuning.clone()).unwrap()),
        Box::new(Ukf::new(model(), tuning.clone()).unwrap()),
        Box::new(Mhe::new(model(), tuning, 3).unwrap()),
    ]
}

#[test]
fn a_step_of_an_estimator_allocates_nothing() {
    let measurements = [
        [8.0, 13.0],
        [f64::NAN, 13.1],
        [f64::NAN; 2],
        [1e6, -1e6],
        [1e300, f64::INFINITY],
        [8.0, 13.0],
        [8.1, 12.9],
    ];
    for disturbance in disturbances() {
        for mut estimator in estimators(&disturbance) {
            let before = requests();
            for _ in 0..5 {
                for y in &measurements {
                    estimator.correct(y);
                    estimator.predict(&[1.6, 4.0]);
                }
            }
            estimator.reset();
            assert_eq!(requests() - before, 0, "{disturbance:?}");
        }
    }
}

#[test]
fn the_models_allocate_nothing() {
    for disturbance in disturbances() {
        let augmented = Augmented::new(tanks(), augmentation(disturbance.clone())).unwrap();
        let compensated = Compensated::new(tanks(), augmentation(disturbance.clone())).unwrap();
        let models: [Box<dyn Model>; 2] = [Box::new(augmented), Box::new(compensated)];
        for mut model in models {
            let (dims, points) = (model.dims(), 37);
            let x = vec![5.0; points * dims.nx];
            let u = vec![2.0; points * dims.nu];
            let p = vec![0.1; points * dims.np];
            let mut buffer = LinearizationBuffer::new(dims, points);
            let before = requests();
            model.linearize(Stages { x: &x, u: &u, p: &p }, buffer.as_mut());
            assert_eq!(requests() - before, 0, "{disturbance:?}");
        }
    }
}
