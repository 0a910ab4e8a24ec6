//! Which coefficients a polynomial has, and which pairs of them make up the coefficients of a product.

use std::sync::Arc;

/// The monomials of some variables up to a degree, by degree, with the pairs that make up each.
#[derive(Debug)]
struct Monomials {
    exponents: Vec<Vec<u8>>,
    /// How many have degree 0, at most 1, at most 2, ..
    counts: Vec<usize>,
    /// The pairs of all monomials, one after the other.
    pairs: Vec<[u16; 2]>,
    /// Where the pairs of each monomial begin, and where the last ones end.
    first_pair: Vec<usize>,
}

/// The coefficients of a polynomial in the time and in some variables: for each power k of the
/// time all monomials of the variables up to a degree D(k), which does not grow with k.
///
/// Time and variables are scaled to [0, 1] and [-1, 1].
#[derive(Clone, Debug)]
pub(crate) struct Basis {
    monomials: Arc<Monomials>,
    /// D(k) for k = 0, 1, ..; none for a power that is left out.
    degrees: Vec<Option<usize>>,
    /// Where the coefficients of each power begin, and where the last end.
    first: Vec<usize>,
    /// The weights of a power of the time and of a degree, and the largest sum of a term that is
    /// kept.
    weights: [usize; 2],
    limit: usize,
}

impl Basis {
    /// Polynomials of total degree `degree` in the variables alone.
    pub(crate) fn of_space(variables: usize, degree: usize) -> Self {
        let monomials = Arc::new(Monomials::new(variables, degree));
        let (degrees, first, weights) = (vec![Some(degree)], Vec::new(), [1, 1]);
        let basis = Self { monomials, degrees: Vec::new(), first, weights, limit: degree };
        basis.with_degrees(degrees)
    }

    /// The same variables with powers of the time up to `order`, whose degrees in the variables fall
    /// from the largest, at the first two powers, to 0: in short steps and small boxes both make a
    /// term small.
    pub(crate) fn with_time(&self, order: usize) -> Self {
        let degree = self.degree();
        // k degree + d order <= (order + 1) degree.
        let (weights, limit) = match degree {
            0 => ([1, 1], order),
            _ => ([degree, order.max(1)], (order + 1) * degree),
        };
        let mut basis = Self { weights, limit, ..self.clone() };
        basis.degrees = vec![Some(degree); order + 1];
        let degrees = basis.degrees_up_to(basis.limit);
        basis.with_degrees(degrees)
    }

    /// The first powers of the time alone, up to `order`.
    pub(crate) fn up_to_order(&self, order: usize) -> Self {
        self.clone().with_degrees(self.degrees[..=order].to_vec())
    }

    /// D(k) for terms that stay in the basis after `further` multiplications by a polynomial without
    /// a constant.
    pub(crate) fn degrees_before(&self, further: usize) -> Vec<Option<usize>> {
        let least = match self.degrees.len() {
            1 => self.weights[1],
            _ => self.weights[0].min(self.weights[1]),
        };
        self.degrees_up_to(self.limit.saturating_sub(further * least))
    }

    /// D(k) for terms of a weight of at most `limit`.
    fn degrees_up_to(&self, limit: usize) -> Vec<Option<usize>> {
        let [of_time, of_degree] = self.weights;
        let of = |(k, degree): (usize, &Option<usize>)| {
            let left = limit.checked_sub(k * of_time)?;
            Some((*degree)?.min(left / of_degree))
        };
        self.degrees.iter().enumerate().map(of).collect()
    }

    /// D(k) for each power of the time.
    pub(crate) fn degrees(&self) -> &[Option<usize>] {
        &self.degrees
    }

    /// How many powers of the time there are.
    pub(crate) fn orders(&self) -> usize {
        self.degrees.len()
    }

    /// How many variables there are.
    pub(crate) fn variables(&self) -> usize {
        self.monomials.exponents[0].len()
    }

    /// The largest degree in the variables.
    pub(crate) fn degree(&self) -> usize {
        self.degrees[0].unwrap_or(0)
    }

    /// How many monomials of the variables have this degree at most.
    pub(crate) fn count(&self, degree: usize) -> usize {
        self.monomials.counts[degree]
    }

    /// The places of the monomials of one degree.
    pub(crate) fn of_degree(&self, degree: usize) -> std::ops::Range<usize> {
        let first = degree.checked_sub(1).map_or(0, |below| self.count(below));
        first..self.count(degree)
    }

    /// How many monomials of the variables there are.
    pub(crate) fn monomials(&self) -> usize {
        self.monomials.exponents.len()
    }

    /// The places of the coefficients of one power of the time, in the order of the monomials.
    pub(crate) fn of_order(&self, k: usize) -> std::ops::Range<usize> {
        self.first[k]..self.first[k + 1]
    }

    /// How many coefficients are kept.
    pub(crate) fn len(&self) -> usize {
        self.first[self.orders()]
    }

    /// The basis with these powers of the time.
    fn with_degrees(self, degrees: Vec<Option<usize>>) -> Self {
        let mut first = vec![0];
        for (k, degree) in degrees.iter().enumerate() {
            first.push(first[k] + degree.map_or(0, |degree| self.count(degree)));
        }
        Self { degrees, first, ..self }
    }

    /// The exponents of the monomial at a place.
    pub(crate) fn exponents(&self, place: usize) -> &[u8] {
        &self.monomials.exponents[place]
    }

    /// The places of pairs of monomials whose product is the one at `place`.
    #[inline(always)]
    pub(crate) fn pairs(&self, place: usize) -> &[[u16; 2]] {
        let Monomials { pairs, first_pair, .. } = &*self.monomials;
        &pairs[first_pair[place]..first_pair[place + 1]]
    }

    /// The most terms that are added up to one coefficient of a product.
    pub(crate) fn most_terms(&self) -> usize {
        let longest = (0..self.monomials()).map(|place| self.pairs(place).len()).max().unwrap_or(1);
        longest * self.orders()
    }
}

impl Monomials {
    fn new(variables: usize, degree: usize) -> Self {
        let (mut exponents, mut counts) = (Vec::new(), Vec::new());
        for d in 0..=degree {
            append(&mut exponents, &mut vec![0; variables], 0, d);
            counts.push(exponents.len());
        }
        let (mut pairs, mut first_pair) = (Vec::new(), vec![0]);
        for of in &exponents {
            for (i, a) in exponents.iter().enumerate() {
                let rest: Option<Vec<u8>> =
                    of.iter().zip(a).map(|(of, a)| of.checked_sub(*a)).collect();
                let place = rest.and_then(|rest| exponents.iter().position(|b| *b == rest));
                pairs.extend(place.map(|j| [narrow(i), narrow(j)]));
            }
            first_pair.push(pairs.len());
        }
        Self { exponents, counts, pairs, first_pair }
    }
}

fn narrow(place: usize) -> u16 {
    u16::try_from(place).expect("fewer than 2^16 monomials")
}

/// Appends the monomials of degree `left` in the variables from `variable` on.
fn append(to: &mut Vec<Vec<u8>>, exponents: &mut Vec<u8>, variable: usize, left: usize) {
    if variable + 1 >= exponents.len() {
        if let Some(last) = exponents.last_mut() {
            *last = u8::try_from(left).expect("small degrees");
        } else if left > 0 {
            return;
        }
        to.push(exponents.clone());
        return;
    }
    for of in (0..=left).rev() {
        exponents[variable] = u8::try_from(of).expect("small degrees");
        append(to, exponents, variable + 1, left - of);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_a_product() {
        let basis = Basis::of_space(3, 4);
        assert_eq!([basis.count(0), basis.count(1), basis.count(4)], [1, 4, 35]);
        let pairs: usize = (0..basis.monomials()).map(|place| basis.pairs(place).len()).sum();
        // Pairs of monomials of total degree 4 at most, in six variables.
        assert_eq!(pairs, 210);
        for place in 0..basis.monomials() {
            for [a, b] in basis.pairs(place) {
                let sum = basis.exponents((*a).into()).iter().zip(basis.exponents((*b).into()));
                let sum: Vec<u8> = sum.map(|(a, b)| a + b).collect();
                assert_eq!(sum, basis.exponents(place));
            }
        }
    }

    #[test]
    fn degrees_fall_with_the_power_of_the_time() {
        let basis = Basis::of_space(2, 3).with_time(6);
        let some = |degrees: [usize; 7]| degrees.map(Some).to_vec();
        assert_eq!(basis.degrees(), some([3, 3, 2, 2, 1, 1, 0]));
        // A multiplication adds a power of the time at least.
        let before = [Some(3), Some(2), Some(2), Some(1), Some(1), Some(0), Some(0)];
        assert_eq!(basis.degrees_before(1), before);
        assert_eq!(basis.up_to_order(1).degrees(), [Some(3); 2]);
        let space = Basis::of_space(2, 3);
        assert_eq!(space.degrees_before(2), [Some(1)]);
        let point = Basis::of_space(0, 0).with_time(2);
        assert_eq!((point.degrees(), point.len()), (&[Some(0); 3][..], 3));
        assert_eq!(point.degrees_before(1), [Some(0), Some(0), None]);
    }
}
