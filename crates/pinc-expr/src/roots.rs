//! Algebraic equations at one point: their root, why there is none, and whether there are others.

use crate::algebraic::LARGEST_BLOCK;
use crate::critical::short;
use crate::implicit::{AlgebraicSystem, OnPrograms};
use crate::{Equations, ExpressionError};
use pinc_ad::{NewtonRoot, NewtonSystem, Scalar};
use std::fmt;
use thiserror::Error;

/// Roots that are closer than this, in widths of the box, are one.
const SAME: f64 = 1e-6;

/// dg/dz whose smallest pivot is this part of 1 counts as singular: with it, an error of rounding
/// in g is one of 1e-6 in z.
const SINGULAR: f64 = 1e-10;

/// The algebraic equations of a plant, for a look at single points.
#[derive(Clone, Debug)]
pub struct AlgebraicEquations {
    states: usize,
    inputs: usize,
    pub(crate) system: AlgebraicSystem,
}

/// Algebraic variables at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct AlgebraicRoot {
    /// The variables, in the order of [`AlgebraicEquations::names`].
    pub values: Vec<f64>,
    /// For each system that is solved at once, the sign of the determinant of dg/dz: it changes
    /// only where dg/dz is singular or jumps.
    pub signs: Vec<f64>,
}

/// Algebraic equations that are not solved at a point.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{}: {reason}", keys(equations))]
pub struct Unsolved {
    /// The variables to which the equations are given that are solved at once.
    pub equations: Vec<String>,
    /// Why.
    pub reason: UnsolvedReason,
}

/// Why equations are not solved.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum UnsolvedReason {
    /// They have no finite value at the start of the search.
    Undefined {
        /// The unknowns with their values there.
        start: Vec<(String, f64)>,
    },
    /// dg/dz is singular where the search ended.
    Singular {
        /// The unknowns with their values there.
        at: Vec<(String, f64)>,
    },
    /// No root in the box was found.
    NoRoot {
        /// The unknowns with their values where the search ended.
        at: Vec<(String, f64)>,
        /// The residuals there.
        residuals: Vec<f64>,
        /// Whether dg/dz is singular there, so that the search could not go on.
        is_singular: bool,
    },
}

fn keys(equations: &[String]) -> String {
    let keys: Vec<_> = equations.iter().map(|name| format!("algebraic.{name}")).collect();
    keys.join(", ")
}

impl fmt::Display for UnsolvedReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let listed = |values: &[(String, f64)]| {
            let all: Vec<_> =
                values.iter().map(|(name, v)| format!("{name} = {}", short(*v))).collect();
            all.join(", ")
        };
        match self {
            Self::Undefined { start } => {
                write!(f, "not defined where the search starts, at {}", listed(start))
            }
            Self::Singular { at } => {
                write!(
                    f,
                    "the derivative by the unknowns is singular at {}, where the equations do not \
                     determine them",
                    listed(at)
                )
            }
            Self::NoRoot { at, residuals, is_singular } => {
                let residuals: Vec<_> = residuals.iter().map(|g| short(*g)).collect();
                write!(
                    f,
                    "no root found in the box: the search ended at {}, where {} should be 0{}",
                    listed(at),
                    residuals.join(", "),
                    if *is_singular {
                        " and the derivative by the unknowns is singular"
                    } else {
                        ""
                    }
                )
            }
        }
    }
}

impl Equations {
    /// The algebraic equations, all parameters fixed; `None` if there are none.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with the equations.
    pub fn algebraic_equations(&self) -> Result<Option<AlgebraicEquations>, ExpressionError> {
        Ok(self.compile()?.algebraic.map(|system| AlgebraicEquations {
            states: self.states.len(),
            inputs: self.inputs.len(),
            system,
        }))
    }
}

impl AlgebraicEquations {
    /// The names of the algebraic variables.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.system.names
    }

    /// The equations that are solved at once for each sign of [`AlgebraicRoot::signs`].
    #[must_use]
    pub fn systems(&self) -> Vec<String> {
        self.system.blocks.iter().map(|block| keys(&block.equations)).collect()
    }

    /// Solves at a point, as the plant does.
    ///
    /// # Shapes
    ///
    /// `at`: `nx + nu`, states first.
    ///
    /// # Errors
    ///
    /// The first equations that are not solved, and why.
    pub fn solve(&self, at: &[f64]) -> Result<AlgebraicRoot, Unsolved> {
        self.system.examine(self.parts(at))
    }

    /// A root other than the one of [`AlgebraicEquations::solve`], if a search from other places in
    /// the boxes finds one: `parts` has, for each of them, the place of each unknown between the
    /// low (0) and the high end (1) of its box.
    ///
    /// # Shapes
    ///
    /// `at`: `nx + nu`, states first; each of `parts`: as many as there are unknowns.
    #[must_use]
    pub fn another_root(&self, at: &[f64], parts: &[Vec<f64>]) -> Option<Vec<(String, f64)>> {
        let found = self.solve(at).ok()?;
        let [x, u, p] = self.parts(at);
        for (b, block) in self.system.blocks.iter().enumerate() {
            for part in parts {
                let mut z = found.values.clone();
                let mut on = OnPrograms { block: &self.system.blocks[b], x, u, p, z: &mut z };
                let mut start = [0.0; LARGEST_BLOCK];
                for (i, &unknown) in block.unknowns.iter().enumerate() {
                    let [low, high] = block.limits[i];
                    start[i] = low + part[unknown] * (high - low);
                }
                let root: NewtonRoot<f64, LARGEST_BLOCK> = on.find(start);
                let differs = block.unknowns.iter().enumerate().any(|(i, &unknown)| {
                    let [low, high] = block.limits[i];
                    (root.z[i] - found.values[unknown]).abs() > SAME * (high - low)
                });
                if root.unsolved.all_nonpositive() && differs {
                    return Some(self.system.named(b, &root.z));
                }
            }
        }
        None
    }

    fn parts<'a>(&self, at: &'a [f64]) -> [&'a [f64]; 3] {
        let (x, rest) = at.split_at(self.states);
        [x, &rest[..self.inputs], &[]]
    }
}

impl AlgebraicSystem {
    fn named(&self, block: usize, z: &[f64]) -> Vec<(String, f64)> {
        let unknowns = self.blocks[block].unknowns.iter();
        unknowns.zip(z).map(|(unknown, z)| (self.names[*unknown].clone(), *z)).collect()
    }

    /// Solves block by block.
    pub(crate) fn examine(&self, [x, u, p]: [&[f64]; 3]) -> Result<AlgebraicRoot, Unsolved> {
        let mut values = vec![f64::NAN; self.names.len()];
        let mut signs = Vec::new();
        for (b, block) in self.blocks.iter().enumerate() {
            let n = block.unknowns.len();
            let mut on = OnPrograms { block, x, u, p, z: &mut values };
            let (mut g, mut slopes) = ([0.0; LARGEST_BLOCK], [[0.0; LARGEST_BLOCK]; LARGEST_BLOCK]);
            let start: [f64; LARGEST_BLOCK] = on.start();
            on.linearize(&start, &mut g, &mut slopes);
            let unsolved = |reason| Unsolved { equations: block.equations.clone(), reason };
            if !(start[..n].iter().chain(&g[..n]).all(|value| value.is_finite())) {
                return Err(unsolved(UnsolvedReason::Undefined { start: self.named(b, &start) }));
            }
            let root = on.find(start);
            on.linearize(&root.z, &mut g, &mut slopes);
            let at = || self.named(b, &root.z);
            let (sign, pivot) = determinant(&block.limits[..n], slopes);
            let is_singular = pivot.is_nan() || pivot <= SINGULAR;
            // From a root where dg/dz is singular Newton's method has no step, as from no root.
            let is_root = root.unsolved.all_nonpositive() || g[..n].iter().all(|g| g.abs() <= 0.0);
            if !is_root {
                let residuals = g[..n].to_vec();
                return Err(unsolved(UnsolvedReason::NoRoot { at: at(), residuals, is_singular }));
            }
            if is_singular {
                return Err(unsolved(UnsolvedReason::Singular { at: at() }));
            }
            signs.push(sign);
            for (&unknown, z) in block.unknowns.iter().zip(&root.z) {
                values[unknown] = *z;
            }
        }
        Ok(AlgebraicRoot { values, signs })
    }
}

/// The sign of the determinant, and the smallest pivot of the matrix with unknowns in widths of
/// their boxes and rows of largest entry 1.
fn determinant(limits: &[[f64; 2]], mut a: [[f64; LARGEST_BLOCK]; LARGEST_BLOCK]) -> (f64, f64) {
    let n = limits.len();
    for row in &mut a[..n] {
        row.iter_mut().zip(limits).for_each(|(entry, [low, high])| *entry *= high - low);
        let largest = row[..n].iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
        row[..n].iter_mut().for_each(|entry| *entry /= largest);
    }
    let (mut sign, mut smallest) = (1.0, f64::INFINITY);
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs())).unwrap_or(k);
        if pivot != k {
            a.swap(pivot, k);
            sign = -sign;
        }
        let upper = a[k];
        sign *= upper[k].signum();
        // A NaN stays visible.
        smallest = if upper[k].abs() >= smallest { smallest } else { upper[k].abs() };
        for row in &mut a[k + 1..n] {
            let factor = row[k] / upper[k];
            row.iter_mut().zip(upper).for_each(|(entry, above)| *entry -= factor * above);
        }
    }
    (sign, smallest)
}
