//! A plant of one's own: its equation in Rust, and the same as text.
//!
//! `cargo run -p pinc-ode --example 01_own_plant`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::Scalar;
use pinc_expr::Equations;
use pinc_ode::{Dopri5, Plant, Variable};
use std::error::Error;

/// A pendulum with friction, pushed by a torque: angle' = rate, rate' = torque - g sin(angle) - d
/// rate.
#[derive(Clone, Debug)]
struct Pendulum {
    /// In 1/s.
    friction: f64,
}

impl Plant for Pendulum {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] =
            [Variable::new("angle", "rad"), Variable::new("rate", "rad/s")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("torque", "rad/s^2")];
        &INPUTS
    }

    // So that it becomes part of vectorized loops.
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = x[1];
        dx[1] = u[0] - x[0].sin() * 9.81 - x[1] * self.friction;
    }
}

/// The same equation as text, as it would stand in a config file.
fn equations() -> Equations {
    let text = |name: &str, text: &str| (name.to_owned(), text.to_owned());
    Equations {
        states: Pendulum { friction: 0.1 }.states().to_vec(),
        inputs: Pendulum { friction: 0.1 }.inputs().to_vec(),
        parameters: [("g".to_owned(), 9.81), ("d".to_owned(), 0.1)].into(),
        intermediates: [text("weight", "g*sin(angle)")].into(),
        derivatives: [text("angle", "rate"), text("rate", "torque - weight - d*rate")].into(),
        ..Equations::default()
    }
}

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let plant = Pendulum { friction: 0.1 };
    println!("states {:?}, inputs {:?}", plant.states(), plant.inputs());

    // Two seconds under a constant torque, to a local error of 1e-10.
    let mut x = [0.5, 0.0];
    Dopri5::new(plant, 1e-10).integrate(&mut x, &[1.0], 2.0)?;
    println!("after 2 s, compiled:  {x:.9?}");

    let mut y = [0.5, 0.0];
    Dopri5::new(equations().compile()?, 1e-10).integrate(&mut y, &[1.0], 2.0)?;
    println!("after 2 s, from text: {y:.9?}");
    assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-8));

    // What is wrong in a text is said with its place.
    let mut wrong = equations();
    wrong.derivatives.insert("rate".to_owned(), "torque - wieght".to_owned());
    let error = wrong.compile().err().ok_or("a name that nothing has")?;
    println!("{error}");
    assert!(error.to_string().contains("weight"));
    Ok(())
}
