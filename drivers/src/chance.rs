//! Random numbers that are a pure function of a seed and a counter, so that a world, a schedule
//! of faults or a test is the same on every machine and in any order of asking.

/// A seeded source; cheap to copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chance(u64);

impl Chance {
    /// A source of its own for every seed.
    pub const fn new(seed: u64) -> Self {
        Self(mix(seed ^ 0x9e37_79b9_7f4a_7c15))
    }

    /// A source of its own for every `key` (a frame, a channel, a kind of fault).
    #[must_use]
    pub const fn of(self, key: u64) -> Self {
        Self(mix(self.0 ^ mix(key.wrapping_add(0x632b_e59b_d9b4_e019))))
    }

    /// 64 even bits for `counter`.
    pub const fn bits(self, counter: u64) -> u64 {
        mix(self
            .0
            .wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// Even in [0, 1).
    pub fn unit(self, counter: u64) -> f64 {
        (self.bits(counter) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with mean 0 and standard deviation 1 (Box & Muller 1958).
    pub fn normal(self, counter: u64) -> f32 {
        let bits = self.bits(counter);
        // 32 bits for each of the two even numbers; the first is kept above 0 for the logarithm.
        let radius = ((bits >> 32) as f32 + 0.5) * (1.0 / 4_294_967_296.0);
        let turn = (bits as u32) as f32 * (std::f32::consts::TAU / 4_294_967_296.0);
        (-2.0 * radius.ln()).max(0.0).sqrt() * turn.cos()
    }
}

/// The finaliser of SplitMix64 (Steele, Lea & Flood 2014).
const fn mix(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let source = Chance::new(7);
        let n = 100_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for counter in 0..n {
            let value = f64::from(source.normal(counter));
            sum += value;
            squares += value * value;
        }
        let (mean, variance) = (sum / n as f64, squares / n as f64);
        // Four standard errors at 100 000 samples.
        assert!(mean.abs() < 4.0 / (n as f64).sqrt(), "mean {mean}");
        assert!(
            (variance - 1.0).abs() < 4.0 * (2.0 / n as f64).sqrt(),
            "variance {variance}"
        );
    }

    #[test]
    fn keys_give_sources_of_their_own() {
        let source = Chance::new(7);
        assert_ne!(source.of(1).bits(0), source.of(2).bits(0));
        assert_eq!(source.of(1).bits(5), Chance::new(7).of(1).bits(5));
    }
}
