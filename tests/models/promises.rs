//! A model's promises besides its Jacobians.

use crate::candidates::candidates;
use crate::harness::{Point, bits, fingerprint, linearize, linearize_output, output, step};
use pinc_ode::{Dims, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};
use proptest::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A call of a model with vectors of given lengths.
type Call<'a> = &'a dyn Fn(&mut dyn Model, Vec<Vec<f64>>);

#[test]
fn dimensions_and_sample_time_make_sense() {
    for candidate in candidates() {
        let model = candidate.build();
        let Dims { nx, nu, np, ny, .. } = model.dims();
        assert!(nx > 0 && nu > 0 && ny > 0, "{}", candidate.name);
        assert_eq!(candidate.ranges().len(), nx + nu + np, "{}: box", candidate.name);
        let sample_time_s = model.sample_time_s();
        assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "{}", candidate.name);
    }
}

/// Same arguments, same bits: on one model, on another one, and whatever was asked in between, NaN
/// included.
#[test]
fn deterministic_and_without_memory() {
    for candidate in candidates() {
        let (mut one, mut other) = (candidate.build(), candidate.build());
        let dims = one.dims();
        let point = candidate.middle();
        let first = fingerprint(&mut *one, &point);
        let moved: Vec<_> = point.variables().iter().map(|v| v * 1.1 + 0.01).collect();
        fingerprint(&mut *one, &Point::new(&moved, dims));
        let unknown = vec![f64::NAN; moved.len()];
        fingerprint(&mut *one, &Point::new(&unknown, dims));
        assert_eq!(fingerprint(&mut *one, &point), first, "{}", candidate.name);
        assert_eq!(fingerprint(&mut *other, &point), first, "{}", candidate.name);
    }
}

#[test]
fn every_entry_is_written_and_finite() {
    for candidate in candidates() {
        candidate.on_points(|model, at| {
            let LinearizationBuffer { next, a, b, e } = linearize(model, at);
            let outputs = linearize_output(model, at);
            let all = [next, a, b, e, outputs.y, outputs.c, outputs.d, outputs.e];
            for v in all.concat() {
                prop_assert!(v.abs() < 1e15, "{}", v);
            }
            Ok(())
        });
    }
}

/// Whether two numbers agree to the rounding of some hundred operations.
fn close(a: f64, b: f64, size: f64) -> bool {
    (a - b).abs() <= 1000.0 * f64::EPSILON * size
}

/// Checks that two lists of numbers with `width` per point agree, relative to the largest number in
/// the place of each.
fn all_close(a: &[f64], b: &[f64], width: usize) -> bool {
    let size = |i: usize| b.iter().skip(i % width).step_by(width).fold(0.0, |m, v| v.abs().max(m));
    let largest = b.iter().fold(0.0, |m: f64, v| v.abs().max(m));
    a.len() == b.len()
        && a.iter().zip(b).enumerate().all(|(i, (a, b))| {
            close(*a, *b, size(i)) || close(*a, *b, 1e-3 * largest) || close(*a, *b, 1.0)
        })
}

#[test]
fn values_of_both_methods_agree() {
    for candidate in candidates() {
        candidate.on_points(|model, at| {
            let (width, outputs) = (model.dims().nx, model.dims().ny);
            let (value, next) = (step(model, at), linearize(model, at).next);
            prop_assert!(all_close(&next, &value, width), "{:?} {:?}", next, value);
            let (value, y) = (output(model, at), linearize_output(model, at).y);
            prop_assert!(all_close(&y, &value, outputs), "{:?} {:?}", y, value);
            Ok(())
        });
    }
}

/// Several points at once are several points: up to 9 of them, at which whatever works on 8 at a
/// time has one left over.
#[test]
fn stages_are_linearized_like_points() {
    for candidate in candidates() {
        candidate.on_points(|model, at| {
            let Dims { nx, nu, np, ny, .. } = model.dims();
            for count in [0, 1, 2, 5, 9] {
                let moved = |k: u32| -> Vec<f64> {
                    let factor = 1.0 + 0.01 * f64::from(k);
                    at.variables().iter().map(|v| v * factor).collect()
                };
                let points: Vec<_> =
                    (0..count).map(|k| Point::new(&moved(k), model.dims())).collect();
                let joined = Point::join(&points);
                let all = linearize(model, &joined);
                let outputs = linearize_output(model, &joined);
                let each: Vec<_> = points.iter().map(|point| linearize(model, point)).collect();
                let each_output: Vec<_> =
                    points.iter().map(|point| linearize_output(model, point)).collect();
                let part = |f: fn(&LinearizationBuffer) -> &Vec<f64>| {
                    each.iter().flat_map(|r| f(r).clone()).collect::<Vec<_>>()
                };
                prop_assert!(all_close(&all.next, &part(|r| &r.next), nx));
                prop_assert!(all_close(&all.a, &part(|r| &r.a), nx * nx));
                prop_assert!(all_close(&all.b, &part(|r| &r.b), nx * nu));
                prop_assert!(all_close(&all.e, &part(|r| &r.e), (nx * np).max(1)));
                let y: Vec<_> = each_output.iter().flat_map(|r| r.y.clone()).collect();
                let c: Vec<_> = each_output.iter().flat_map(|r| r.c.clone()).collect();
                prop_assert!(all_close(&outputs.y, &y, ny) && all_close(&outputs.c, &c, ny * nx));
            }
            Ok(())
        });
    }
}

/// Derivatives by parameters that are not wanted change nothing else, up to rounding.
#[test]
fn derivatives_by_parameters_may_be_left_out() {
    for candidate in candidates() {
        candidate.on_points(|model, at| {
            let Dims { nx, nu, .. } = model.dims();
            let full = linearize(model, at);
            let LinearizationBuffer { mut next, mut a, mut b, .. } =
                LinearizationBuffer::new(model.dims(), 1);
            let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
            model.linearize(at.stages(), out);
            prop_assert!(all_close(&next, &full.next, nx));
            prop_assert!(all_close(&a, &full.a, nx * nx) && all_close(&b, &full.b, nx * nu));
            let with_e = linearize_output(model, at);
            let mut without = with_e.clone();
            let OutputLinearization { y, c, d, .. } = without.as_mut();
            model.linearize_output(at.stages(), OutputLinearization { y, c, d, e: &mut [] });
            prop_assert_eq!(&with_e, &without);
            Ok(())
        });
    }
}

/// A point without a value does not disturb the others, not even by a bit.
#[test]
fn stages_do_not_depend_on_one_another() {
    for candidate in candidates() {
        let mut model = candidate.build();
        let mut points = vec![candidate.middle(); 7];
        let n = model.dims().nx;
        let all = linearize(&mut *model, &Point::join(&points));
        points[3].x.fill(f64::NAN);
        let one_bad = linearize(&mut *model, &Point::join(&points));
        for k in [0, 1, 2, 4, 5, 6] {
            let part = |linear: &LinearizationBuffer| {
                [bits(&linear.next[k * n..][..n]), bits(&linear.a[k * n * n..][..n * n])]
            };
            assert_eq!(part(&all), part(&one_bad), "{}: point {k}", candidate.name);
        }
    }
}

/// A NaN in a state reaches that state of the next step at least, one in an input some state, one
/// in a parameter some state or output; nothing panics.
#[test]
fn nan_in_nan_out() {
    for candidate in candidates() {
        let mut model = candidate.build();
        let middle = candidate.middle().variables();
        let (dims, n) = (model.dims(), model.dims().nx);
        for i in 0..middle.len() {
            let mut variables = middle.clone();
            variables[i] = f64::NAN;
            let at = Point::new(&variables, dims);
            let (next, linear) = (step(&mut *model, &at), linearize(&mut *model, &at).next);
            let y = output(&mut *model, &at);
            for next in [next, linear] {
                let poisoned = if i < n {
                    next[i].is_nan()
                } else {
                    let outputs = y.iter().filter(|_| i >= n + dims.nu);
                    next.iter().chain(outputs).any(|v| v.is_nan())
                };
                assert!(poisoned, "{}: argument {i}, {next:?}", candidate.name);
            }
        }
    }
}

/// Far outside of any domain a model may be wrong, but must not panic.
#[test]
fn no_panic_on_any_number() {
    for candidate in candidates() {
        let mut model = candidate.build();
        let middle = candidate.middle();
        for value in
            [f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -1e9, 0.0, -0.0, f64::MIN_POSITIVE]
        {
            for part in 0..3 {
                let mut at = middle.clone();
                [&mut at.x, &mut at.u, &mut at.p][part].fill(value);
                fingerprint(&mut *model, &at);
            }
        }
    }
}

/// Slices of other lengths are a programming error, which must not go unnoticed.
#[test]
fn other_lengths_panic() {
    for candidate in candidates() {
        let Dims { nx, nu, np, ny, .. } = candidate.build().dims();
        // x, u, p, then the results.
        let step = [nx, nu, np, nx];
        let linear = [nx, nu, np, nx, nx * nx, nx * nu, nx * np];
        let outputs = [nx, nu, np, ny, ny * nx, ny * nu, ny * np];
        let refused = |lengths: &[usize], wrong: usize, call: Call<'_>| {
            for change in [-1, 1] {
                let mut lengths = lengths.to_vec();
                let length = lengths[wrong].checked_add_signed(change);
                // No derivatives by p are none wanted.
                let Some(length) = length.filter(|&l| wrong < 6 || l > 0) else { continue };
                lengths[wrong] = length;
                let values = lengths.iter().map(|&len| vec![1.0; len]).collect();
                let mut model = candidate.build();
                let outcome = catch_unwind(AssertUnwindSafe(|| call(&mut *model, values)));
                assert!(outcome.is_err(), "{}: {wrong} of {lengths:?}", candidate.name);
            }
        };
        for wrong in (0..step.len()).filter(|&wrong| wrong != 2 || np > 0) {
            refused(&step, wrong, &|model, values| {
                let [x, u, p, mut next] = values.try_into().expect("four");
                model.step(&x, &u, &p, &mut next);
            });
        }
        for wrong in 0..linear.len() {
            refused(&linear, wrong, &|model, values| {
                let [x, u, p, mut next, mut a, mut b, mut e] = values.try_into().expect("seven");
                let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut e };
                model.linearize(Stages { x: &x, u: &u, p: &p }, out);
            });
            refused(&outputs, wrong, &|model, values| {
                let [x, u, p, mut y, mut c, mut d, mut e] = values.try_into().expect("seven");
                let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut e };
                model.linearize_output(Stages { x: &x, u: &u, p: &p }, out);
            });
        }
    }
}
