//! Texts as equations: compiled or refused with a message, and of a plant the same values on every
//! kind of number. The first two lines are the derivatives of the states, further ones `name =
//! expression`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use pinc_ad::Dual;
use pinc_expr::Equations;
use pinc_ode::{Plant, Variable};

fn equations(text: &str) -> Equations {
    let mut lines = text.lines();
    let mut derivative = |name: &str| (name.to_owned(), lines.next().unwrap_or("x").to_owned());
    let derivatives = [derivative("x"), derivative("y")].into();
    let intermediates = lines.filter_map(|line| line.split_once('='));
    Equations {
        states: vec![Variable::new("x", ""), Variable::new("y", "m")],
        inputs: vec![Variable::new("u", "")],
        parameters: Default::default(),
        intermediates: intermediates.map(|(n, e)| (n.trim().to_owned(), e.to_owned())).collect(),
        derivatives,
        ..Equations::default()
    }
}

fuzz_target!(|text: &str| {
    let plant = match equations(text).compile() {
        Ok(plant) => plant,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return;
        }
    };
    for (x, u) in [([0.5, -2.0], [1.5]), ([0.0, 0.0], [0.0])] {
        let mut plain = [0.0; 2];
        plant.rhs(&x, &u, &[], &mut plain);
        let mut dual = [Dual::<f64>::lift(0.0); 2];
        plant.rhs(&x.map(|v| Dual::variable(v, 0)), &u.map(Dual::lift), &[], &mut dual);
        for (plain, dual) in plain.iter().zip(dual) {
            let same = *plain == dual.re || plain.is_nan() && dual.re.is_nan();
            assert!(same, "{plain} on f64, {} on a dual number", dual.re);
        }
    }
});
