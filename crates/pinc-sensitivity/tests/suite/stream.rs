//! Random numbers.

/// Numbers from a multiplicative congruence, of which the high bits are used (multiplier: Steele
/// and Vigna, Softw. Pract. Exper. 52 (2022)).
#[derive(Clone, Debug)]
pub(crate) struct Stream(u64);

impl Stream {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
        self.0 >> 11
    }

    pub(crate) fn within(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.bits() as f64 / (1_u64 << 53) as f64
    }
}
