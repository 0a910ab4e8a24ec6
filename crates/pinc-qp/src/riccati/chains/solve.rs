//! The solution on chains, with their factors.

use super::{Lanes, gather, low, scatter};
use pinc_ad::simd::{Simd, Work};

/// See [`Chains::backward`](super::Chains::backward).
pub(super) struct Backward<'a, V> {
    pub(super) chains: &'a mut Lanes<V>,
    pub(super) g: &'a [f64],
    pub(super) c: &'a [f64],
    pub(super) linear: &'a mut [f64],
}

impl<V: Simd> Work for Backward<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { chains, g, c, linear } = self;
        sized!(chains.dims, |n, m| chains.backward_sized(g, c, linear, (n, m)));
    }
}

/// See [`Chains::roll_out`](super::Chains::roll_out).
pub(super) struct RollOut<'a, V> {
    pub(super) chains: &'a mut Lanes<V>,
    pub(super) c: &'a [f64],
    pub(super) d: &'a mut [f64],
    pub(super) lambda: &'a mut [f64],
}

impl<V: Simd> Work for RollOut<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { chains, c, d, lambda } = self;
        sized!(chains.dims, |n, m| chains.roll_out_sized(c, d, lambda, (n, m)));
    }
}

impl<V: Simd> Lanes<V> {
    #[inline(always)]
    fn backward_sized(&mut self, g: &[f64], c: &[f64], linear: &mut [f64], (n, m): (usize, usize)) {
        let (zero, dims, s) = (self.zero, self.dims, n + m);
        let (by_x, by_u) = g.split_at(dims.all_states());
        self.linear[(self.levels - 1) * s..].fill(zero);
        for level in (0..self.levels).rev() {
            let node = self.node(level);
            let (before, here) = self.linear.split_at_mut(level * s);
            let here = &mut here[..s];
            if node < dims.n_controls {
                let forward = &mut self.forward[level * m..(level + 1) * m];
                for k in 0..m {
                    here[n + k] = here[n + k] + gather(zero, by_u, node, m, k);
                    forward[k] = here[n + k];
                }
                let gain = &self.gain[level * m * s..(level + 1) * m * s];
                for k in 0..m {
                    for e in 0..s {
                        here[e] = forward[k].neg_mul_add(gain[k * s + e], here[e]);
                    }
                }
                let pivot = &self.pivot[level * m * m..(level + 1) * m * m];
                for r in 0..m {
                    for k in 0..r {
                        forward[r] = pivot[r * m + k].neg_mul_add(forward[k], forward[r]);
                    }
                    forward[r] = forward[r] * pivot[r * m + r];
                }
                for r in (0..m).rev() {
                    for k in r + 1..m {
                        forward[r] = pivot[k * m + r].neg_mul_add(forward[k], forward[r]);
                    }
                    forward[r] = forward[r] * pivot[r * m + r];
                }
            }
            for (e, entry) in here[..n].iter_mut().enumerate() {
                *entry = *entry + gather(zero, by_x, node - 1, n, e);
            }
            if level == 0 {
                break;
            }
            // P c + p, then F' of it
            let p = &self.p[level * s * s..(level + 1) * s * s];
            let sum = &mut self.vector[..s];
            sum.copy_from_slice(here);
            for k in 0..n {
                let offset = gather(zero, c, node - 1, n, k);
                for (e, sum) in sum.iter_mut().enumerate() {
                    *sum = p[low(e, k, s)].mul_add(offset, *sum);
                }
            }
            let f = &self.model[level * n * s..(level + 1) * n * s];
            let target = &mut before[(level - 1) * s..];
            for e in 0..s {
                let mut value = if e < n { zero } else { sum[e] };
                for k in 0..n {
                    value = f[k * s + e].mul_add(sum[k], value);
                }
                target[e] = value;
            }
        }
        for e in 0..s {
            scatter(self.linear[e], linear, self.first, s, e);
        }
    }

    #[inline(always)]
    fn roll_out_sized(
        &mut self,
        c: &[f64],
        d: &mut [f64],
        lambda: &mut [f64],
        (n, m): (usize, usize),
    ) {
        let (zero, dims, s) = (self.zero, self.dims, n + m);
        let (states, inputs) = d.split_at_mut(dims.all_states());
        // s_j = (dx_j, du_{j-1})
        let (now, later) = self.product.split_at_mut(s);
        for (e, now) in now[..n].iter_mut().enumerate() {
            *now = gather(zero, states, self.first - 1, n, e);
        }
        for k in 0..m {
            let before = |lane: usize| inputs[dims.input_of(self.first - 1 + lane) * m + k];
            now[n + k] = zero.generate(before);
        }
        for level in 0..self.levels {
            let node = self.first + level * dims.tree.scenarios();
            if level > 0 {
                let f = &self.model[level * n * s..(level + 1) * n * s];
                for r in 0..n {
                    let mut value = gather(zero, c, node - 1, n, r);
                    for e in 0..s {
                        value = f[r * s + e].mul_add(now[e], value);
                    }
                    later[r] = value;
                    scatter(value, states, node - 1, n, r);
                }
                now[..n].copy_from_slice(&later[..n]);
            }
            let p = &self.p[level * s * s..(level + 1) * s * s];
            for r in 0..n {
                let mut value = self.linear[level * s + r];
                for e in 0..s {
                    value = p[low(r, e, s)].mul_add(now[e], value);
                }
                scatter(value, lambda, node - 1, n, r);
            }
            if node < dims.n_controls {
                let gain = &self.gain[level * m * s..(level + 1) * m * s];
                for k in 0..m {
                    let mut value = now[n + k] - self.forward[level * m + k];
                    for e in 0..s {
                        value = gain[k * s + e].neg_mul_add(now[e], value);
                    }
                    later[k] = value;
                    scatter(value, inputs, node, m, k);
                }
                now[n..s].copy_from_slice(&later[..m]);
            }
        }
    }
}
