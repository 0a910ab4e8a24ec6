//! Taylor models: polynomials with a bound of what is missing, in several boxes at once.

use crate::basis::Basis;
use crate::chebyshev::Interpolation;
use crate::function::Smooth;
use crate::interval::Interval;
use crate::kernel::{LANES, Lanes, add_multiples, lanes, memory, norm, product, release};
use crate::rounding::{UNIT, to_f64, up};
use pinc_ad::simd::Isa;
use std::cell::LazyCell;

/// In each box a polynomial of time and variables, and a bound of how far the true value is from
/// it, anywhere in the box; infinite where nothing is known.
#[derive(Debug)]
pub(crate) struct Taylor {
    pub(crate) coefficients: Vec<Lanes>,
    pub(crate) remainder: Lanes,
}

impl Clone for Taylor {
    fn clone(&self) -> Self {
        let mut coefficients = memory(self.coefficients.len());
        coefficients.copy_from_slice(&self.coefficients);
        Self { coefficients, remainder: self.remainder }
    }
}

impl Drop for Taylor {
    fn drop(&mut self) {
        release(std::mem::take(&mut self.coefficients));
    }
}

/// The arithmetic of Taylor models over one basis.
///
/// Rounding: a coefficient that is a sum of m products is off by at most (m + 1) u times the sum of
/// their absolute values (Higham, Accuracy and Stability of Numerical Algorithms, chapter 3), and
/// the sum of these over all coefficients is at most the product of the norms. Every operation adds
/// twice that to the remainder.
#[derive(Clone, Debug)]
pub(crate) struct Arithmetic {
    pub(crate) basis: Basis,
    interpolation: Interpolation,
    isa: Isa,
    /// Whether remainders are kept; polynomials that need not be exact are found without.
    is_rigorous: bool,
}

/// The absolute values of coefficients, summed by the power of the time and the degree, without
/// rounding upward.
struct Norms {
    /// For each power k and degree d the sum, at k (D(0) + 2) + d.
    at_degree: Vec<Lanes>,
    /// The sums over degree d and above, likewise.
    from_degree: Vec<Lanes>,
    width: usize,
    total: Lanes,
    /// Which powers have coefficients other than 0.
    orders: Vec<bool>,
}

impl Taylor {
    /// The sum of the coefficients' absolute values, with or without the constant, without rounding
    /// upward.
    fn norm_from(&self, first: usize) -> Lanes {
        norm(Isa::detect(), &self.coefficients[first..])
    }

    /// The same polynomial with another remainder.
    pub(crate) fn with_remainder(mut self, remainder: Lanes) -> Self {
        self.remainder = remainder;
        self
    }

    /// A range in one box.
    pub(crate) fn range(&self, lane: usize, norm_without_constant: &Lanes) -> Interval {
        let radius = up(norm_without_constant[lane] + self.remainder[lane]);
        Interval::around(self.coefficients[0][lane], radius)
    }

    /// A range in each box.
    pub(crate) fn ranges(&self) -> Vec<Interval> {
        let norm = self.norm_from(1);
        (0..LANES).map(|lane| self.range(lane, &norm)).collect()
    }
}

impl Arithmetic {
    /// Over `basis`, with functions fitted by polynomials of degree `fit`.
    pub(crate) fn new(basis: Basis, fit: usize, isa: Isa) -> Self {
        Self { basis, interpolation: Interpolation::new(fit), isa, is_rigorous: true }
    }

    /// The same without remainders: polynomials alone.
    pub(crate) fn without_remainders(self) -> Self {
        Self { is_rigorous: false, ..self }
    }

    /// The numbers `values`, one per box.
    pub(crate) fn constant(&self, values: Lanes) -> Taylor {
        let mut coefficients = memory(self.basis.len());
        coefficients[0] = values;
        Taylor { coefficients, remainder: [0.0; LANES] }
    }

    /// A polynomial of a basis with fewer powers of the time, or the first powers of one of a basis
    /// with more.
    pub(crate) fn resize(&self, of: &Taylor) -> Taylor {
        let mut coefficients = memory(self.basis.len());
        let count = coefficients.len().min(of.coefficients.len());
        coefficients[..count].copy_from_slice(&of.coefficients[..count]);
        Taylor { coefficients, remainder: of.remainder }
    }

    /// A model of which nothing is known in any box.
    pub(crate) fn unknown(&self) -> Taylor {
        self.constant([0.0; LANES]).with_remainder([f64::INFINITY; LANES])
    }

    pub(crate) fn add(&self, a: &Taylor, b: &Taylor) -> Taylor {
        self.combine(&[a, b], &[1.0, 1.0], 0.0)
    }

    pub(crate) fn sub(&self, a: &Taylor, b: &Taylor) -> Taylor {
        self.combine(&[a, b], &[1.0, -1.0], 0.0)
    }

    pub(crate) fn scale(&self, a: &Taylor, factor: f64) -> Taylor {
        self.combine(&[a], &[factor], 0.0)
    }

    pub(crate) fn offset(&self, a: &Taylor, number: f64) -> Taylor {
        self.combine(&[a], &[1.0], number)
    }

    /// The sum of `of` times `factors`, and a number.
    pub(crate) fn combine(&self, of: &[&Taylor], factors: &[f64], number: f64) -> Taylor {
        let norms: Vec<Lanes> = of.iter().map(|a| self.size(a)).collect();
        self.weighted((of, &norms), factors, number)
    }

    /// The outputs of a layer: for each row of weights the sum of `of` times these, and a bias.
    pub(crate) fn layer(&self, of: &[Taylor], weights: &[Vec<f64>], bias: &[f64]) -> Vec<Taylor> {
        let norms: Vec<Lanes> = of.iter().map(|a| self.size(a)).collect();
        let of: Vec<&Taylor> = of.iter().collect();
        let rows = weights.iter().zip(bias);
        rows.map(|(row, bias)| self.weighted((&of, &norms), row, *bias)).collect()
    }

    /// The sum of the coefficients' absolute values, where remainders are kept.
    fn size(&self, of: &Taylor) -> Lanes {
        if self.is_rigorous { of.norm_from(0) } else { [0.0; LANES] }
    }

    /// A sum of models with these norms.
    fn weighted(
        &self,
        (of, norms): (&[&Taylor], &[Lanes]),
        factors: &[f64],
        number: f64,
    ) -> Taylor {
        let mut sum = self.constant([number; LANES]);
        let polynomials: Vec<&[Lanes]> = of.iter().map(|a| &a.coefficients[..]).collect();
        add_multiples(self.isa, &mut sum.coefficients, &polynomials, factors);
        let mut size = [number.abs(); LANES];
        for ((a, norm), factor) in of.iter().zip(norms).zip(factors) {
            for i in 0..LANES {
                size[i] += factor.abs() * norm[i];
                sum.remainder[i] += factor.abs() * a.remainder[i];
            }
        }
        let units = 2.0 * to_f64(of.len() + 1) * UNIT;
        sum.remainder = lanes(|i| unless_nan(up(sum.remainder[i] + units * size[i])));
        sum
    }

    pub(crate) fn mul(&self, a: &Taylor, b: &Taylor) -> Taylor {
        self.mul_up_to(a, b, self.basis.degrees())
    }

    /// The product, with coefficients up to `degrees` alone.
    fn mul_up_to(&self, a: &Taylor, b: &Taylor, degrees: &[Option<usize>]) -> Taylor {
        if !self.is_rigorous {
            let [of_a, of_b] = [a, b].map(|of| self.orders(of));
            let (a, b) = ((&a.coefficients[..], &of_a[..]), (&b.coefficients[..], &of_b[..]));
            let coefficients = product(self.isa, &self.basis, degrees, a, b);
            return Taylor { coefficients, remainder: [0.0; LANES] };
        }
        let (of_a, of_b) = (self.norms(a), self.norms(b));
        let coefficients = product(
            self.isa,
            &self.basis,
            degrees,
            (&a.coefficients, &of_a.orders),
            (&b.coefficients, &of_b.orders),
        );
        let dropped = self.dropped(&of_a, &of_b, degrees);
        let units = (2.0 * to_f64(self.basis.most_terms()) + 4.0) * UNIT;
        let remainder = lanes(|i| {
            let (ra, rb) = (a.remainder[i], b.remainder[i]);
            let (na, nb) = (of_a.total[i], of_b.total[i]);
            up(dropped[i] + na * rb + nb * ra + ra * rb + units * na * nb)
        });
        Taylor { coefficients, remainder: remainder.map(unless_nan) }
    }

    /// A bound of the terms of a product beyond `degrees`.
    fn dropped(&self, a: &Norms, b: &Norms, degrees: &[Option<usize>]) -> Lanes {
        let mut sum = [0.0; LANES];
        for i in (0..a.orders.len()).filter(|i| a.orders[*i]) {
            for j in (0..b.orders.len()).filter(|j| b.orders[*j]) {
                let kept = degrees.get(i + j).copied().flatten();
                for d in 0..a.width - 1 {
                    // The first degree of the other factor that leads beyond.
                    let from = kept.map_or(0, |kept| (kept + 1).saturating_sub(d));
                    let from = from.min(b.width - 1);
                    let one = &a.at_degree[i * a.width + d];
                    let other = &b.from_degree[j * b.width + from];
                    for lane in 0..LANES {
                        sum[lane] += one[lane] * other[lane];
                    }
                }
            }
        }
        sum
    }

    /// Adds to each of `changes` how much a model changes with that variable in box `lane`: the sum
    /// of the absolute coefficients, times the exponents.
    pub(crate) fn add_changes(&self, of: &Taylor, lane: usize, changes: &mut [f64]) {
        for k in 0..self.basis.orders() {
            for (place, at) in self.basis.of_order(k).enumerate() {
                for (change, power) in changes.iter_mut().zip(self.basis.exponents(place)) {
                    *change += of.coefficients[at][lane].abs() * f64::from(*power);
                }
            }
        }
    }

    /// Which powers of the time have coefficients other than 0.
    fn orders(&self, of: &Taylor) -> Vec<bool> {
        let has = |k| {
            let mut all = of.coefficients[self.basis.of_order(k)].as_flattened().iter();
            all.any(|coefficient| coefficient.abs() > 0.0 || coefficient.is_nan())
        };
        (0..self.basis.orders()).map(has).collect()
    }

    fn norms(&self, of: &Taylor) -> Norms {
        let (basis, width) = (&self.basis, self.basis.degree() + 2);
        let mut at_degree = vec![[0.0; LANES]; basis.orders() * width];
        let mut from_degree = at_degree.clone();
        let mut orders = vec![false; basis.orders()];
        let mut total = [0.0; LANES];
        for (k, degree) in basis.degrees().iter().enumerate() {
            let Some(degree) = *degree else { continue };
            for d in (0..=degree).rev() {
                let places = basis.of_degree(d);
                let first = basis.of_order(k).start;
                let here =
                    norm(self.isa, &of.coefficients[first + places.start..first + places.end]);
                let above = from_degree[k * width + d + 1];
                at_degree[k * width + d] = here;
                from_degree[k * width + d] = lanes(|i| here[i] + above[i]);
            }
            let all = from_degree[k * width];
            orders[k] = all.iter().any(|norm| *norm > 0.0 || norm.is_nan());
            total = lanes(|i| total[i] + all[i]);
        }
        Norms { at_degree, from_degree, width, total, orders }
    }

    pub(crate) fn div(&self, a: &Taylor, b: &Taylor) -> Taylor {
        self.mul(a, &self.compose(Smooth::Recip, b))
    }

    /// A function of a model: the polynomial that fits it on the model's range, by Horner's rule,
    /// in which terms that the multiplications still to come would drop are dropped before.
    pub(crate) fn compose(&self, function: Smooth, a: &Taylor) -> Taylor {
        let polynomial_radius = a.norm_from(1);
        let middle = a.coefficients[0];
        let radius = lanes(|i| up(polynomial_radius[i] + a.remainder[i]));
        let fits: Vec<_> =
            (0..LANES).map(|i| self.interpolation.fit(function, middle[i], radius[i])).collect();
        let inverse = radius.map(|radius| if radius > 0.0 { 1.0 / radius } else { 0.0 });
        let known = |i: usize| fits[i].is_some();
        let mut scaled = a.clone();
        scaled.coefficients[0] = [0.0; LANES];
        for coefficient in &mut scaled.coefficients {
            *coefficient = lanes(|i| if known(i) { coefficient[i] * inverse[i] } else { 0.0 });
        }
        // The inverse and the products change each coefficient by 2 u at most: what a product of m
        // terms adds for its own (m + 1) u, (2 m + 4) u, has room for it.
        scaled.remainder = [0.0; LANES];
        let degree = self.interpolation.degree();
        let power = |n: usize| lanes(|i| fits[i].as_ref().map_or(0.0, |fit| fit.powers[n]));
        let mut sum = self.constant(power(degree));
        for n in (0..degree).rev() {
            let degrees = self.basis.degrees_before(n);
            sum = self.mul_up_to(&sum, &scaled, &degrees);
            // A product with a polynomial that has no constant has none: nothing is rounded.
            sum.coefficients[0] = power(n);
        }
        sum.remainder = lanes(|i| match &fits[i] {
            // The three parts have room for the roundings of their sum.
            Some(fit) => unless_nan(sum.remainder[i] + fit.error + fit.slope * a.remainder[i]),
            None => f64::INFINITY,
        });
        sum
    }

    /// A range in each box that is narrower where powers of the time alone are large: these are within
    /// \[0, 1\], not \[-1, 1\].
    pub(crate) fn ranges_in_time(&self, of: &Taylor) -> Vec<Interval> {
        let norm = of.norm_from(1);
        let of_time: Vec<usize> = (1..self.basis.orders())
            .map(|k| self.basis.of_order(k))
            .filter(|places| !places.is_empty())
            .map(|places| places.start)
            .collect();
        let range = |lane: usize| {
            let alone = || of_time.iter().map(|place| of.coefficients[*place][lane]);
            // c t^k is not below 0 with c > 0, nor above it with c < 0; the sums are rounded down.
            let sum = |sign: f64| alone().map(|c| (sign * c).max(0.0)).sum::<f64>() * (1.0 - 1e-12);
            let Interval { low, high } = of.range(lane, &norm);
            Interval { low: (low + sum(1.0)).next_down(), high: (high - sum(-1.0)).next_up() }
        };
        (0..LANES).map(range).collect()
    }

    /// In each box `yes` where `of` is nowhere positive, `no` where it is nowhere 0 or less;
    /// unknown elsewhere.
    pub(crate) fn choose(&self, of: &Taylor, yes: &Taylor, no: &Taylor) -> Taylor {
        let mut chosen = self.unknown();
        let narrow = LazyCell::new(|| self.ranges_in_time(of));
        let side = |range: Interval| match range {
            Interval { high, .. } if high <= 0.0 => Some(yes),
            Interval { low, .. } if low > 0.0 => Some(no),
            Interval { .. } => None,
        };
        for (lane, range) in of.ranges().into_iter().enumerate() {
            let Some(from) = side(range).or_else(|| side(narrow[lane])) else { continue };
            for (to, from) in chosen.coefficients.iter_mut().zip(&from.coefficients) {
                to[lane] = from[lane];
            }
            chosen.remainder[lane] = from.remainder[lane];
        }
        chosen
    }
}

/// What is no number says nothing.
pub(crate) fn unless_nan(bound: f64) -> f64 {
    if bound.is_nan() { f64::INFINITY } else { bound }
}
