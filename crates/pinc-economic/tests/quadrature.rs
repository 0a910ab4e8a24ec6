//! A cost integrated along a model that only says where it is at given times.

use pinc_economic::Quadrature;
use pinc_ode::{Dims, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};
use std::convert::Infallible;

/// x + p u s after s seconds.
#[derive(Debug)]
struct Line(f64);

impl Model for Line {
    fn dims(&self) -> Dims {
        Dims::new(1, 1).with_parameters(1)
    }

    fn sample_time_s(&self) -> f64 {
        self.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        next[0] = x[0] + p[0] * u[0] * self.0;
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        for k in 0..at.x.len() {
            out.next[k] = at.x[k] + at.p[k] * at.u[k] * self.0;
            (out.a[k], out.b[k]) = (1.0, at.p[k] * self.0);
            if let Some(e) = out.e.get_mut(k) {
                *e = at.u[k] * self.0;
            }
        }
    }
}

/// The outputs x, l = t^2 x^3 + u x + p, and 0, of (x, t, J).
#[derive(Debug)]
struct Rate;

impl Model for Rate {
    fn dims(&self) -> Dims {
        Dims::new(3, 1).with_parameters(1).with_outputs(3)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, _: &[f64], _: &[f64], _: &[f64], _: &mut [f64]) {
        unreachable!("only the outputs are asked for");
    }

    fn linearize(&mut self, _: Stages<'_>, _: Linearization<'_>) {
        unreachable!("only the outputs are asked for");
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        y.copy_from_slice(&[x[0], x[1].powi(2) * x[0].powi(3) + u[0] * x[0] + p[0], 0.0]);
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let (x, t, u) = (at.x[0], at.x[1], at.u[0]);
        self.output(at.x, at.u, at.p, out.y);
        out.c.fill(0.0);
        (out.c[0], out.c[3], out.c[4]) = (1.0, 3.0 * t * t * x * x + u, 2.0 * t * x.powi(3));
        out.d.copy_from_slice(&[0.0, x, 0.0]);
        if !out.e.is_empty() {
            out.e.copy_from_slice(&[0.0, 1.0, 0.0]);
        }
    }
}

fn extended(length: f64) -> Quadrature {
    let line = |after_s| -> Result<Box<dyn Model>, Infallible> { Ok(Box::new(Line(after_s))) };
    Quadrature::new(length, line, Box::new(Rate)).unwrap()
}

/// The integral of l from the time t on, by its antiderivative in s: with x + v s for x, l is a
/// polynomial of degree 5.
fn integral(x: f64, t: f64, u: f64, p: f64, length: f64) -> f64 {
    let v = p * u;
    // (t + s)^2 (x + v s)^3 + u (x + v s) + p
    let square = [t * t, 2.0 * t, 1.0];
    let cube = [x.powi(3), 3.0 * x * x * v, 3.0 * x * v * v, v.powi(3)];
    let mut coefficients = [0.0; 6];
    for (i, a) in square.iter().enumerate() {
        for (k, b) in cube.iter().enumerate() {
            coefficients[i + k] += a * b;
        }
    }
    coefficients[0] += u * x + p;
    coefficients[1] += u * v;
    let power = |i: usize| i32::try_from(i).unwrap() + 1;
    let terms = coefficients.iter().enumerate();
    terms.map(|(i, c)| c * length.powi(power(i)) / f64::from(power(i))).sum()
}

#[test]
fn polynomials_of_degree_5_are_integrated_exactly() {
    let (x, u, p, length) = ([0.7, 0.4, 2.5], 0.6, 1.3, 1.7);
    let mut next = [0.0; 3];
    extended(length).step(&x, &[u], &[p], &mut next);
    let expected = 2.5 + integral(0.7, 0.4, u, p, length);
    assert!((next[0] - (0.7 + p * u * length)).abs() < 1e-14);
    assert!((next[1] - 2.1).abs() < 1e-14);
    assert!((next[2] - expected).abs() < 1e-12, "{} {expected}", next[2]);
}

/// At two points, so that one does not write into the other's numbers.
#[test]
fn derivatives_match_the_integral() {
    let (dims, length) = (Rate.dims(), 1.7);
    let points = [[0.7, 0.4, 2.5, 0.6, 1.3], [-0.3, 1.1, 0.0, -0.8, 0.9]];
    let gather = |part: std::ops::Range<usize>| -> Vec<f64> {
        points.iter().flat_map(|point| point[part.clone()].to_vec()).collect()
    };
    let (x, u, p) = (gather(0..3), gather(3..4), gather(4..5));
    let mut found = LinearizationBuffer::new(dims, 2);
    extended(length).linearize(Stages { x: &x, u: &u, p: &p }, found.as_mut());
    for (k, point) in points.iter().enumerate() {
        let next = |point: &[f64]| {
            let mut next = [0.0; 3];
            extended(length).step(&point[..3], &point[3..4], &point[4..], &mut next);
            next
        };
        for (row, value) in next(point).iter().enumerate() {
            assert!((found.next[3 * k + row] - value).abs() < 1e-12, "{k} {row}");
        }
        for i in 0..5 {
            let moved = |by: f64| {
                let mut moved = *point;
                moved[i] += by;
                next(&moved)
            };
            let (ahead, behind) = (moved(1e-5), moved(-1e-5));
            for row in 0..3 {
                let expected = (ahead[row] - behind[row]) / 2e-5;
                let at = 3 * k + row;
                let derivative = match i {
                    0..3 => found.a[3 * at + i],
                    3 => found.b[at],
                    _ => found.e[at],
                };
                assert!((derivative - expected).abs() < 1e-7, "{k} {row} {i}: {derivative}");
            }
        }
    }
}
