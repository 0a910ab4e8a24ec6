//! What a controller asks of a model: the next state and its Jacobians A = dx\[k+1\]/dx\[k\] and
//! B = dx\[k+1\]/du\[k\].
//!
//! `cargo run -p pinc-ode --example 03_linearize`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ode::{Dims, Linearization, Model, Rk4, Stages};
use pinc_plants::FourTanks;

pub(crate) fn main() {
    // Levels in cm, pump voltages in V, steps of 10 s.
    let mut model = Rk4::new(FourTanks::antonelo(), 10.0, 2);
    let Dims { nx: n, nu: m, .. } = model.dims();
    let (x, u) = ([12.0, 12.0, 2.0, 2.0], [3.0_f64, 3.0]);

    let (mut next, mut a, mut b) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n * m]);
    model.linearize(
        Stages { x: &x, u: &u, p: &[] },
        Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
    );
    println!("next levels {next:.4?}");
    for (a, b) in a.chunks(n).zip(b.chunks(m)) {
        println!("A {a:8.4?}   B {b:8.4?}");
    }

    // Row i, column k of B: what 0.001 V more at pump k does to level i.
    let mut moved = vec![0.0; n];
    for k in 0..m {
        let mut more = u;
        more[k] += 1e-3;
        model.step(&x, &more, &[], &mut moved);
        for i in 0..n {
            let slope: f64 = (moved[i] - next[i]) / 1e-3;
            assert!((slope - b[i * m + k]).abs() < 1e-3, "B[{i}][{k}]");
        }
    }
}
