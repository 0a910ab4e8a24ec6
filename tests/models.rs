//! One suite for every model that a controller may be given: what [`Model`] promises.

use pinc_net::{Ansatz, Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{Dims, Linearization, Model, Plant, Rk4, Rk5, Rodas4, Stages};
use pinc_plants::{FourTanks, OneTank, VanDerPol};
use proptest::prelude::*;
use proptest::test_runner::{FileFailurePersistence, TestCaseError, TestRunner};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::{Cell, RefCell};
use std::panic::catch_unwind;

/// A model under test, and the box of states and inputs to try it in.
struct Candidate {
    name: &'static str,
    build: fn() -> Box<dyn Model>,
    state: [f64; 2],
    input: [f64; 2],
}

/// Every model there is.
const MODELS: [Candidate; 13] = [
    model("RK4, Van der Pol", || rk4(VanDerPol::default(), 0.5), [-3.0, 3.0], [-1.0, 1.0]),
    model("RK5, Van der Pol", || rk5(VanDerPol::default(), 0.5), [-3.0, 3.0], [-1.0, 1.0]),
    model("RK5, four tanks", || rk5(FourTanks::antonelo(), 10.0), [2.0, 20.0], [0.0, 5.0]),
    model("RK4, one tank", || rk4(OneTank::default(), 10.0), [2.0, 20.0], [0.5, 4.5]),
    model("RK4, four tanks", || rk4(FourTanks::antonelo(), 10.0), [2.0, 20.0], [0.0, 5.0]),
    model(
        "RK4, nonminimum",
        || rk4(FourTanks::johansson_nonminimum(), 10.0),
        [2.0, 20.0],
        [0.0, 5.0],
    ),
    model("RK4, minimum", || rk4(FourTanks::johansson_minimum(), 10.0), [2.0, 20.0], [0.0, 5.0]),
    model(
        "Rodas4, Van der Pol",
        || Box::new(Rodas4::new(VanDerPol::default(), 0.5, 4)),
        [-3.0, 3.0],
        [-1.0, 1.0],
    ),
    model(
        "Rodas4, four tanks",
        || Box::new(Rodas4::new(FourTanks::antonelo(), 10.0, 4)),
        [2.0, 20.0],
        [0.0, 5.0],
    ),
    model(
        "net, Van der Pol",
        || net(VanDerPol::default(), Ansatz::Direct),
        [-3.0, 3.0],
        [-1.0, 1.0],
    ),
    model(
        "hard net, Van der Pol",
        || net(VanDerPol::default(), Ansatz::HardLinear),
        [-3.0, 3.0],
        [-1.0, 1.0],
    ),
    model(
        "net, four tanks",
        || net(FourTanks::antonelo(), Ansatz::Direct),
        [-3.0, 3.0],
        [-1.0, 1.0],
    ),
    model(
        "hard net, four tanks",
        || net(FourTanks::antonelo(), Ansatz::HardLinear),
        [-3.0, 3.0],
        [-1.0, 1.0],
    ),
];

const fn model(
    name: &'static str,
    build: fn() -> Box<dyn Model>,
    state: [f64; 2],
    input: [f64; 2],
) -> Candidate {
    Candidate { name, build, state, input }
}

fn rk4<P: Plant>(plant: P, sample_time_s: f64) -> Box<dyn Model> {
    Box::new(Rk4::new(plant, sample_time_s, 4))
}

fn rk5<P: Plant>(plant: P, sample_time_s: f64) -> Box<dyn Model> {
    Box::new(Rk5::new(plant, sample_time_s, 2))
}

/// A net with its starting weights: what it predicts is of no matter here.
fn net<P: Plant>(plant: P, ansatz: Ansatz) -> Box<dyn Model> {
    let dims = plant.dims();
    let domain = Domain::new(vec![-3.0..=3.0; dims.nx], vec![-1.0..=1.0; dims.nu]);
    let config = NetConfig { ansatz, ..NetConfig::new(0.5, 3, 9) };
    let net = PincNet::new(&plant, &config, &domain, 7).expect("a net");
    Box::new(PincModel::new(&net).expect("a model"))
}

/// What `linearize` gives, in buffers of the right lengths.
#[derive(Clone, Debug)]
struct Linear {
    next: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
}

fn predict(model: &mut dyn Model, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut next = vec![0.0; x.len()];
    model.step(x, u, &[], &mut next);
    next
}

fn linearize(model: &mut dyn Model, x: &[f64], u: &[f64]) -> Linear {
    let (n, m) = (x.len(), u.len());
    // Not zeros: an entry that is left out must show.
    let [mut next, mut a, mut b] = [n, n * n, n * m].map(|len| vec![1e300; len]);
    model.linearize(
        Stages { x, u, p: &[] },
        Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
    );
    Linear { next, a, b }
}

/// What `linearize_stages` gives at the points, one after the other.
fn linearize_stages(model: &mut dyn Model, points: &[(Vec<f64>, Vec<f64>)]) -> Linear {
    let Dims { nx: n, nu: m, .. } = model.dims();
    let [mut next, mut a, mut b] = [n, n * n, n * m].map(|len| vec![1e300; points.len() * len]);
    let x: Vec<f64> = points.iter().flat_map(|(x, _)| x.clone()).collect();
    let u: Vec<f64> = points.iter().flat_map(|(_, u)| u.clone()).collect();
    model.linearize(
        Stages { x: &x, u: &u, p: &[] },
        Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
    );
    Linear { next, a, b }
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// All that both methods give, bit for bit.
fn fingerprint(model: &mut dyn Model, x: &[f64], u: &[f64]) -> [Vec<u64>; 4] {
    let Linear { next, a, b } = linearize(model, x, u);
    [predict(model, x, u), next, a, b].map(|v| bits(&v))
}

impl Candidate {
    fn build(&self) -> Box<dyn Model> {
        (self.build)()
    }

    /// The middle of the box.
    fn middle(&self) -> (Vec<f64>, Vec<f64>) {
        let dims = self.build().dims();
        let middle = |[low, high]: [f64; 2], len| vec![(low + high) / 2.0; len];
        (middle(self.state, dims.nx), middle(self.input, dims.nu))
    }

    /// Runs `check` on random (x, u) of the box.
    fn on_points(
        &self,
        check: impl Fn(&mut dyn Model, &[f64], &[f64]) -> Result<(), TestCaseError>,
    ) {
        let model = RefCell::new(self.build());
        let dims = model.borrow().dims();
        let range = |[low, high]: [f64; 2], len| prop::collection::vec(low..high, len);
        let points = (range(self.state, dims.nx), range(self.input, dims.nu));
        let config = ProptestConfig {
            failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("regressions"))),
            ..ProptestConfig::with_cases(100)
        };
        let outcome =
            TestRunner::new(config).run(&points, |(x, u)| check(&mut **model.borrow_mut(), &x, &u));
        if let Err(failure) = outcome {
            panic!("{}: {failure}", self.name);
        }
    }
}

#[test]
fn dimensions_and_horizon_make_sense() {
    for model in &MODELS {
        let predictor = model.build();
        let dims = predictor.dims();
        assert!(dims.nx > 0 && dims.nu > 0, "{}", model.name);
        let horizon = predictor.sample_time_s();
        assert!(horizon > 0.0 && horizon.is_finite(), "{}", model.name);
    }
}

/// Same arguments, same bits: on one predictor, on another one, and whatever was asked in between,
/// NaN included.
#[test]
fn deterministic_and_without_memory() {
    for model in &MODELS {
        let (mut one, mut other) = (model.build(), model.build());
        let (x, u) = model.middle();
        let first = fingerprint(&mut *one, &x, &u);
        let elsewhere: Vec<_> = x.iter().map(|v| v + 0.5).collect();
        fingerprint(&mut *one, &elsewhere, &u);
        fingerprint(&mut *one, &vec![f64::NAN; x.len()], &vec![f64::NAN; u.len()]);
        assert_eq!(fingerprint(&mut *one, &x, &u), first, "{}", model.name);
        assert_eq!(fingerprint(&mut *other, &x, &u), first, "{}", model.name);
    }
}

#[test]
fn every_entry_is_written_and_finite() {
    for model in &MODELS {
        model.on_points(|model, x, u| {
            let Linear { next, a, b } = linearize(model, x, u);
            for v in [next, a, b].concat() {
                prop_assert!(v.abs() < 1e6, "{}", v);
            }
            Ok(())
        });
    }
}

/// The two values may differ by rounding: a model takes some hundred operations on numbers up to 20.
#[test]
fn predict_and_linearize_agree() {
    for model in &MODELS {
        model.on_points(|model, x, u| {
            let value = predict(model, x, u);
            for (a, b) in linearize(model, x, u).next.iter().zip(&value) {
                prop_assert!((a - b).abs() < 100.0 * 20.0 * f64::EPSILON, "{} {}", a, b);
            }
            Ok(())
        });
    }
}

/// Several points at once are several points: up to 9 of them, at which whatever works on 8 at a time
/// has one left over.
#[test]
fn stages_are_linearized_like_points() {
    for model in &MODELS {
        model.on_points(|model, x, u| {
            for count in [0, 1, 2, 5, 9] {
                let points: Vec<_> = (0..count)
                    .map(|k| (x.iter().map(|v| v + 0.1 * f64::from(k)).collect(), u.to_vec()))
                    .collect();
                let all = linearize_stages(model, &points);
                let mut expected = Linear { next: Vec::new(), a: Vec::new(), b: Vec::new() };
                for (x, u) in &points {
                    let Linear { next, a, b } = linearize(model, x, u);
                    expected.next.extend(next);
                    expected.a.extend(a);
                    expected.b.extend(b);
                }
                let pairs = [(all.next, expected.next), (all.a, expected.a), (all.b, expected.b)];
                for (found, expected) in pairs {
                    prop_assert_eq!(found.len(), expected.len());
                    for (f, e) in found.iter().zip(&expected) {
                        // Some hundred roundings of numbers up to 20.
                        prop_assert!((f - e).abs() < 100.0 * 20.0 * f64::EPSILON, "{} {}", f, e);
                    }
                }
            }
            Ok(())
        });
    }
}

/// A point without a value does not disturb the others, not even by a bit.
#[test]
fn stages_do_not_depend_on_one_another() {
    for model in &MODELS {
        let mut predictor = model.build();
        let (x, u) = model.middle();
        let n = x.len();
        let mut points = vec![(x, u); 7];
        let all = linearize_stages(&mut *predictor, &points);
        points[3].0.fill(f64::NAN);
        let one_bad = linearize_stages(&mut *predictor, &points);
        for k in [0, 1, 2, 4, 5, 6] {
            let part = |linear: &Linear| {
                [bits(&linear.next[k * n..][..n]), bits(&linear.a[k * n * n..][..n * n])]
            };
            assert_eq!(part(&all), part(&one_bad), "{}: point {k}", model.name);
        }
    }
}

/// The derivative of `f` in variable `j`, by Richardson's extrapolation of central differences: good to
/// h^4 = 1e-14 times the fifth derivatives, and to the rounding of the values by h.
fn extrapolated_difference(mut f: impl FnMut(&[f64]) -> f64, at: &[f64], j: usize) -> f64 {
    const H: f64 = 3e-4;
    let mut f = |h: f64| {
        let mut at = at.to_vec();
        at[j] += h;
        f(&at)
    };
    let mut difference = |h: f64| (f(h) - f(-h)) / (2.0 * h);
    (4.0 * difference(H) - difference(2.0 * H)) / 3.0
}

#[test]
fn jacobians_agree_with_differences() {
    for model in &MODELS {
        model.on_points(|model, x, u| {
            let (n, m) = (x.len(), u.len());
            let Linear { a, b, .. } = linearize(model, x, u);
            let at = [x, u].concat();
            for i in 0..n {
                for j in 0..n + m {
                    let f = |v: &[f64]| predict(model, &v[..n], &v[n..])[i];
                    let difference = extrapolated_difference(f, &at, j);
                    let exact = if j < n { a[i * n + j] } else { b[i * m + j - n] };
                    let close = (exact - difference).abs() < 1e-8;
                    prop_assert!(close, "{} {}: {} {}", i, j, exact, difference);
                }
            }
            Ok(())
        });
    }
}

/// A NaN in a state reaches that state of the next step at least, one in an input some state; nothing
/// panics.
#[test]
fn nan_in_nan_out() {
    for model in &MODELS {
        let mut predictor = model.build();
        let (x, u) = model.middle();
        for i in 0..x.len() + u.len() {
            let (mut x, mut u) = (x.clone(), u.clone());
            let n = x.len();
            *x.get_mut(i).unwrap_or_else(|| &mut u[i - n]) = f64::NAN;
            for next in [predict(&mut *predictor, &x, &u), linearize(&mut *predictor, &x, &u).next]
            {
                let poisoned =
                    next.iter().enumerate().any(|(k, v)| v.is_nan() && (i >= n || i == k));
                assert!(poisoned, "{}: argument {i}, {next:?}", model.name);
            }
        }
    }
}

/// Far outside of any domain a model may be wrong, but not fall over.
#[test]
fn no_panic_on_any_number() {
    for model in &MODELS {
        let mut predictor = model.build();
        let (x, u) = model.middle();
        for value in
            [f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -1e9, 0.0, -0.0, f64::MIN_POSITIVE]
        {
            fingerprint(&mut *predictor, &vec![value; x.len()], &u);
            fingerprint(&mut *predictor, &x, &vec![value; u.len()]);
        }
    }
}

/// Slices of other lengths are a programming error, not something to work around.
#[test]
fn other_lengths_panic() {
    for model in &MODELS {
        let (x, u) = model.middle();
        let (n, m) = (x.len(), u.len());
        let right = [n, m, n, n * n, n * m];
        for (wrong, change) in (0..right.len()).flat_map(|i| [(i, -1), (i, 1)]) {
            let mut lengths = right;
            lengths[wrong] = right[wrong].saturating_add_signed(change);
            let [x, u, next, a, b] = lengths.map(|len| vec![1.0; len]);
            let linearize = || {
                let (mut next, mut a, mut b) = (next.clone(), a.clone(), b.clone());
                model.build().linearize(
                    Stages { x: &x, u: &u, p: &[] },
                    Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
                );
            };
            assert!(catch_unwind(linearize).is_err(), "{}: {wrong}", model.name);
            let stages = || {
                let (mut next, mut a, mut b) = (next.clone(), a.clone(), b.clone());
                model.build().linearize(
                    Stages { x: &x, u: &u, p: &[] },
                    Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
                );
            };
            assert!(catch_unwind(stages).is_err(), "{}: {wrong} of stages", model.name);
            let predict = || model.build().step(&x, &u, &[], &mut next.clone());
            let refused = catch_unwind(predict).is_err();
            assert!(refused || wrong > 2, "{}: {wrong} of predict", model.name);
        }
    }
}

/// Counts this thread's allocations, and hands them on to the system.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    ALLOCATIONS.with(|n| n.set(n.get() + 1));
}

#[expect(unsafe_code, reason = "a global allocator is an unsafe trait; this one only counts")]
// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// How many allocations `work` makes.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

#[test]
fn allocations_are_counted() {
    let grow = || {
        let mut v = std::hint::black_box(vec![1_u8]);
        v.reserve_exact(1000);
        std::hint::black_box(&v);
    };
    assert_eq!(allocations(grow), 2);
    assert_eq!(allocations(|| ()), 0);
}

#[test]
fn nothing_is_allocated_after_construction() {
    for model in &MODELS {
        let mut predictor = model.build();
        let (x, u) = model.middle();
        let mut to = linearize(&mut *predictor, &x, &u);
        let (xs, us) = (x.repeat(5), u.repeat(5));
        let mut stages = linearize_stages(&mut *predictor, &vec![(x.clone(), u.clone()); 5]);
        let mut fresh = model.build();
        for predictor in [&mut predictor, &mut fresh] {
            let made = allocations(|| {
                for _ in 0..3 {
                    predictor.step(&x, &u, &[], &mut to.next);
                    predictor.linearize(
                        Stages { x: &x, u: &u, p: &[] },
                        Linearization {
                            next: &mut to.next,
                            a: &mut to.a,
                            b: &mut to.b,
                            e: &mut [],
                        },
                    );
                    let Linear { next, a, b } = &mut stages;
                    predictor.linearize(
                        Stages { x: &xs, u: &us, p: &[] },
                        Linearization { next, a, b, e: &mut [] },
                    );
                }
            });
            assert_eq!(made, 0, "{}", model.name);
        }
    }
}
