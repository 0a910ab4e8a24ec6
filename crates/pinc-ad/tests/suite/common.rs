//! A random family of expressions that uses every operation of [`Scalar`].

use pinc_ad::Scalar;
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;

/// How many variables an expression has.
pub(crate) const INPUTS: usize = 3;

/// An expression in the variables `x[0] .. x[INPUTS - 1]`.
#[derive(Clone, Debug)]
pub(crate) enum Expr {
    Input(usize),
    Constant(f64),
    Add(Box<Self>, Box<Self>),
    Sub(Box<Self>, Box<Self>),
    Mul(Box<Self>, Box<Self>),
    /// a / (b^2 + 1/2), with the sign of the number
    Div(Box<Self>, Box<Self>, f64),
    Neg(Box<Self>),
    AddNumber(Box<Self>, f64),
    SubNumber(Box<Self>, f64),
    MulNumber(Box<Self>, f64),
    DivNumber(Box<Self>, f64),
    /// sqrt(a^2 + 1/2)
    Sqrt(Box<Self>),
    Tanh(Box<Self>),
    Exp(Box<Self>),
    /// ln(a^2 + 1/2)
    Ln(Box<Self>),
    Sin(Box<Self>),
    Cos(Box<Self>),
    /// tan(sin a)
    Tan(Box<Self>),
    Atan(Box<Self>),
    /// (a^2 + 1/2)^1.3
    Powf(Box<Self>),
    Powi(Box<Self>, i32),
    Abs(Box<Self>),
    Min(Box<Self>, Box<Self>),
    Max(Box<Self>, Box<Self>),
    MulAdd(Box<Self>, Box<Self>, Box<Self>),
    WhereNonpositive(Box<Self>, Box<Self>, Box<Self>),
}

impl Expr {
    pub(crate) fn eval<S: Scalar>(&self, x: &[S]) -> S {
        match self {
            Self::Input(i) => x[*i],
            Self::Constant(c) => x[0].constant(*c),
            Self::Add(a, b) => a.eval(x) + b.eval(x),
            Self::Sub(a, b) => a.eval(x) - b.eval(x),
            Self::Mul(a, b) => a.eval(x) * b.eval(x),
            Self::Div(a, b, sign) => {
                let b = b.eval(x);
                a.eval(x) / ((b * b + 0.5) * *sign)
            }
            Self::Neg(a) => -a.eval(x),
            Self::AddNumber(a, c) => a.eval(x) + *c,
            Self::SubNumber(a, c) => a.eval(x) - *c,
            Self::MulNumber(a, c) => a.eval(x) * *c,
            Self::DivNumber(a, c) => a.eval(x) / *c,
            Self::Sqrt(a) => {
                let a = a.eval(x);
                (a * a + 0.5).sqrt()
            }
            Self::Tanh(a) => a.eval(x).tanh(),
            Self::Exp(a) => a.eval(x).exp(),
            Self::Ln(a) => {
                let a = a.eval(x);
                (a * a + 0.5).ln()
            }
            Self::Sin(a) => a.eval(x).sin(),
            Self::Cos(a) => a.eval(x).cos(),
            Self::Tan(a) => a.eval(x).sin().tan(),
            Self::Atan(a) => a.eval(x).atan(),
            Self::Powf(a) => {
                let a = a.eval(x);
                (a * a + 0.5).powf(1.3)
            }
            Self::Powi(a, n) => a.eval(x).powi(*n),
            Self::Abs(a) => a.eval(x).abs(),
            Self::Min(a, b) => a.eval(x).min(b.eval(x)),
            Self::Max(a, b) => a.eval(x).max(b.eval(x)),
            Self::MulAdd(a, b, c) => a.eval(x).mul_add(b.eval(x), c.eval(x)),
            Self::WhereNonpositive(test, yes, no) => {
                test.eval(x).where_nonpositive(yes.eval(x), no.eval(x))
            }
        }
    }

    fn parts(&self) -> Vec<&Self> {
        match self {
            Self::Input(_) | Self::Constant(_) => vec![],
            Self::Neg(a)
            | Self::Sqrt(a)
            | Self::Tanh(a)
            | Self::Exp(a)
            | Self::Ln(a)
            | Self::Sin(a)
            | Self::Cos(a)
            | Self::Tan(a)
            | Self::Atan(a)
            | Self::Powf(a)
            | Self::Powi(a, _)
            | Self::Abs(a) => vec![a],
            Self::AddNumber(a, _)
            | Self::SubNumber(a, _)
            | Self::MulNumber(a, _)
            | Self::DivNumber(a, _) => vec![a],
            Self::Add(a, b)
            | Self::Sub(a, b)
            | Self::Mul(a, b)
            | Self::Div(a, b, _)
            | Self::Min(a, b)
            | Self::Max(a, b) => vec![a, b],
            Self::MulAdd(a, b, c) | Self::WhereNonpositive(a, b, c) => vec![a, b, c],
        }
    }

    /// Whether all intermediate results are at most 4, which bounds every partial derivative by 8
    /// and with it the rounding errors, and no branch is closer than 1e-3 to the place where it or
    /// its derivative jumps, which differences could not stand.
    pub(crate) fn is_tame(&self, x: &[f64]) -> bool {
        let far_from_jump = match self {
            Self::WhereNonpositive(test, ..) | Self::Abs(test) => test.eval(x).abs() > 1e-3,
            Self::Min(a, b) | Self::Max(a, b) => (a.eval(x) - b.eval(x)).abs() > 1e-3,
            _ => true,
        };
        far_from_jump && self.eval(x).abs() <= 4.0 && self.parts().iter().all(|p| p.is_tame(x))
    }
}

/// A number of moderate size, bounded away from 0 so that one can divide by it.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![0.4..2.0, -2.0..-0.4]
}

/// A function of one argument.
fn functions(
    argument: impl Strategy<Value = Box<Expr>> + Clone + 'static,
) -> impl Strategy<Value = Expr> {
    let functions: [fn(Box<Expr>) -> Expr; 10] = [
        Expr::Exp,
        Expr::Ln,
        Expr::Sin,
        Expr::Cos,
        Expr::Tan,
        Expr::Atan,
        Expr::Powf,
        Expr::Abs,
        |a| Expr::Powi(a, 2),
        |a| Expr::Powi(a, 3),
    ];
    (prop::sample::select(functions.to_vec()), argument).prop_map(|(f, a)| f(a))
}

/// Expressions up to four operations deep.
pub(crate) fn expressions() -> impl Strategy<Value = Expr> {
    let leaf = prop_oneof![
        4 => (0..INPUTS).prop_map(Expr::Input),
        1 => number().prop_map(Expr::Constant),
    ];
    leaf.prop_recursive(4, 24, 3, |inner| {
        let one = inner.clone().prop_map(Box::new);
        let two = (one.clone(), one.clone());
        let three = (one.clone(), one.clone(), one.clone());
        let sign = prop_oneof![Just(1.0), Just(-1.0)];
        prop_oneof![
            two.clone().prop_map(|(a, b)| Expr::Add(a, b)),
            two.clone().prop_map(|(a, b)| Expr::Sub(a, b)),
            two.clone().prop_map(|(a, b)| Expr::Mul(a, b)),
            (two.clone(), sign).prop_map(|((a, b), s)| Expr::Div(a, b, s)),
            one.clone().prop_map(Expr::Neg),
            (one.clone(), number()).prop_map(|(a, c)| Expr::AddNumber(a, c)),
            (one.clone(), number()).prop_map(|(a, c)| Expr::SubNumber(a, c)),
            (one.clone(), number()).prop_map(|(a, c)| Expr::MulNumber(a, c)),
            (one.clone(), number()).prop_map(|(a, c)| Expr::DivNumber(a, c)),
            one.clone().prop_map(Expr::Sqrt),
            one.clone().prop_map(Expr::Tanh),
            functions(one),
            two.clone().prop_map(|(a, b)| Expr::Min(a, b)),
            two.prop_map(|(a, b)| Expr::Max(a, b)),
            three.clone().prop_map(|(a, b, c)| Expr::MulAdd(a, b, c)),
            three.prop_map(|(a, b, c)| Expr::WhereNonpositive(a, b, c)),
        ]
    })
}

/// A point to evaluate expressions at.
pub(crate) fn points() -> impl Strategy<Value = [f64; INPUTS]> {
    prop::array::uniform3(-1.5..1.5)
}

/// Failures found are kept beside the test, to be committed.
pub(crate) fn config() -> ProptestConfig {
    ProptestConfig {
        failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("regressions"))),
        max_global_rejects: 20_000,
        ..ProptestConfig::default()
    }
}
