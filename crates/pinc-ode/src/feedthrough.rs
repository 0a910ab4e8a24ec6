//! Which outputs of a plant depend on its inputs.

use crate::Plant;
use pinc_ad::{ImplicitEquations, Scalar};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Returns for each output of `plant` whether its equation contains an input, `ny`. A term counts
/// even where its factor happens to be 0, and so does each side of a branch.
pub(crate) fn feedthrough<P: Plant>(plant: &P) -> Vec<bool> {
    let dims = plant.dims();
    let fixed = |count| vec![Reach(false); count];
    let mut y = fixed(dims.ny);
    plant.output(&fixed(dims.nx), &vec![Reach(true); dims.nu], &fixed(dims.np), &mut y);
    y.into_iter().map(|Reach(reached)| reached).collect()
}

/// A number of which nothing is known but whether an input reaches it.
#[derive(Clone, Copy, Debug)]
struct Reach(bool);

impl Reach {
    fn or(self, other: Self) -> Self {
        Self(self.0 || other.0)
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident),*) => {$(
        impl $trait for Reach {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                self.or(other)
            }
        }
        impl $trait<f64> for Reach {
            type Output = Self;
            fn $method(self, _: f64) -> Self {
                self
            }
        }
    )*};
}
operators!(Add add, Sub sub, Mul mul, Div div);

impl Neg for Reach {
    type Output = Self;
    fn neg(self) -> Self {
        self
    }
}

macro_rules! functions {
    ($($method:ident)*) => {$(
        fn $method(self) -> Self {
            self
        }
    )*};
}

impl Scalar for Reach {
    type Plain = Self;
    const ORDER: usize = 0;

    fn constant(self, _: f64) -> Self {
        Self(false)
    }
    fn constants(self, value: Self) -> Self {
        value
    }
    functions!(plain sqrt exp ln sin cos tan atan tanh);
    fn powf(self, _: f64) -> Self {
        self
    }
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        self.or(yes).or(no)
    }
    fn all_nonpositive(self) -> bool {
        true
    }
    /// The unknowns of an equation inside the plant depend on all that the equation depends on.
    fn declare<E: ImplicitEquations<K, N>, const K: usize, const N: usize>(
        _equations: &E,
        x: &[Self; K],
        _start: [Self; N],
        _limits: &[[f64; 2]; N],
    ) -> Option<[Self; N]> {
        Some([x.iter().fold(Self(false), |all, x| all.or(*x)); N])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Variable;
    use pinc_ad::{Dual, solve_implicit};

    /// z with 0 = z + z^3 - x.
    #[derive(Clone, Debug)]
    struct Cubic;

    impl ImplicitEquations<1, 1> for Cubic {
        fn residuals<S: Scalar>(&self, x: &[S; 1], z: &[S; 1], g: &mut [S; 1]) {
            g[0] = z[0] + z[0].powi(3) - x[0];
        }
    }

    #[derive(Clone, Debug)]
    struct Outputs;

    impl Plant for Outputs {
        fn states(&self) -> &[Variable] {
            static VARIABLES: [Variable; 2] = [Variable::new("a", ""), Variable::new("b", "")];
            &VARIABLES
        }
        fn inputs(&self) -> &[Variable] {
            static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
            &VARIABLES
        }
        fn outputs(&self) -> &[Variable] {
            static VARIABLES: [Variable; 7] = [const { Variable::new("y", "") }; 7];
            &VARIABLES
        }
        fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
            (dx[0], dx[1]) = (u[0], x[0]);
        }
        fn output<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], y: &mut [S]) {
            y[0] = x[0].exp() * x[1] + x[0].constant(2.0);
            y[1] = x[0] + u[0] * 0.0;
            // At x = 0 and u = 0 the other side is taken.
            y[2] = (x[0] - 5.0).max(u[0] - 9.0);
            y[3] = u[0].where_nonpositive(x[0], x[1]);
            [y[4]] = solve_implicit(&Cubic, &[u[0]], [x[0].plain()], &[[-9.0, 9.0]]);
            [y[5]] = solve_implicit(&Cubic, &[x[1]], [x[0].plain()], &[[-9.0, 9.0]]);
            y[6] = u[0].constant(3.0) / x[1];
        }
    }

    #[test]
    fn an_output_depends_on_what_is_in_its_equation() {
        let expected = [false, true, true, true, true, false, false];
        assert_eq!(feedthrough(&Outputs), expected);
        // The derivatives agree, at a point where all terms act.
        let (x, u) = ([0.5, 0.25].map(Dual::<f64, 1>::lift), [Dual::variable(9.0, 0)]);
        let mut y = [Dual::lift(0.0); 7];
        Outputs.output(&x, &u, &[], &mut y);
        assert!(y[2].eps[0] > 0.5 && y[4].eps[0] > 1e-3 && y[0].eps[0].abs() < 1e-15);
    }
}
