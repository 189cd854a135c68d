//! Samples packed as MIPI does it (CSI-2, RAW10 and RAW12) → words of full scale, eight at a time.
//!
//! A group holds the high bytes of its samples, then a byte of their low bits from the first up. A
//! word is that high byte, the low bits below it, and the sample's own high bits below those, so that
//! white is 65535.

use fearless_simd::{Level, Simd, dispatch, prelude::*, u8x16, u16x8};

/// Samples that are unpacked at once.
const SAMPLES: usize = 8;
/// Bytes of a vector.
const VECTOR: usize = 16;

/// How eight samples stand in `BYTES` bytes.
pub(super) struct Packed<const BYTES: usize> {
    /// Where each sample's high byte stands.
    high: [u8; SAMPLES],
    /// Where its low bits stand.
    low: [u8; SAMPLES],
    /// Brings its low bits right below the high byte.
    scale: [u16; SAMPLES],
    /// Those low bits in a word.
    mask: u16,
    /// Brings the high byte right below the low bits.
    shift: u32,
}

/// Four samples in five bytes.
pub(super) const TEN: Packed<10> = Packed {
    high: [0, 1, 2, 3, 5, 6, 7, 8],
    low: [4, 4, 4, 4, 9, 9, 9, 9],
    scale: [64, 16, 4, 1, 64, 16, 4, 1],
    mask: 0xc0,
    shift: 2,
};

/// Two samples in three bytes.
pub(super) const TWELVE: Packed<12> = Packed {
    high: [0, 1, 3, 4, 6, 7, 9, 10],
    low: [2, 2, 5, 5, 8, 8, 11, 11],
    scale: [16, 1, 16, 1, 16, 1, 16, 1],
    mask: 0xf0,
    shift: 4,
};

impl<const BYTES: usize> Packed<BYTES> {
    /// Unpacks a row into as many samples as `out` has, or as many as the row holds.
    pub fn unpack(&self, row: &[u8], out: &mut [u16]) {
        let level = Level::new();
        let groups = if shuffles(level) {
            dispatch!(level, simd => self.vectors(simd, row, out))
        } else {
            0
        };
        let row = row.get(groups * BYTES..).unwrap_or(&[]);
        let out = &mut out[groups * SAMPLES..];
        let (groups, rest) = row.as_chunks::<BYTES>();
        let mut last = [0; BYTES];
        last[..rest.len()].copy_from_slice(rest);
        for (group, out) in groups.iter().chain([&last]).zip(out.chunks_mut(SAMPLES)) {
            let words = self.words(group);
            out.copy_from_slice(&words[..out.len()]);
        }
    }

    #[inline(always)]
    fn words(&self, group: &[u8; BYTES]) -> [u16; SAMPLES] {
        std::array::from_fn(|i| {
            let high = u16::from(group[usize::from(self.high[i])]);
            let low = u16::from(group[usize::from(self.low[i])]);
            high << 8 | ((low * self.scale[i]) & self.mask) | high >> self.shift
        })
    }

    /// Unpacks all groups but the last of a row, which a vector would read beyond; answers how many.
    #[inline(always)]
    fn vectors<S: Simd>(&self, simd: S, row: &[u8], out: &mut [u16]) -> usize {
        let pairs = |of: &[u8; SAMPLES]| -> [u8; VECTOR] { std::array::from_fn(|i| of[i / 2]) };
        let high = u8x16::from_slice(simd, &pairs(&self.high));
        let low = u8x16::from_slice(simd, &pairs(&self.low));
        let scale = u16x8::from_slice(simd, &self.scale);
        let (out, _) = out.as_chunks_mut::<SAMPLES>();
        let readable = row.len().checked_sub(VECTOR);
        let groups = readable.map_or(0, |bytes| bytes / BYTES + 1).min(out.len());
        for (group, out) in out.iter_mut().enumerate().take(groups) {
            let bytes = u8x16::from_slice(simd, &row[group * BYTES..][..VECTOR]);
            let high: u16x8<S> = u16x8::from_bytes(bytes.swizzle_dyn(high));
            let low: u16x8<S> = u16x8::from_bytes(bytes.swizzle_dyn(low));
            let words =
                (high & 0xff00) | ((low * scale) & self.mask) | ((high & 0x00ff) >> self.shift);
            words.store_slice(out);
        }
        groups
    }
}

/// Whether bytes of a vector can be put anywhere in one instruction; done one by one, that takes twice
/// as long as no vectors at all.
fn shuffles(level: Level) -> bool {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    return level.as_sse4_2().is_some();
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    return !level.is_fallback();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Packs samples as the standard says, four of 10 bits or two of 12 bits at a time.
    fn pack(samples: &[u16], bits: u32) -> Vec<u8> {
        let (group, low_bits) = if bits == 10 { (4, 2) } else { (2, 4) };
        let mut row = Vec::new();
        for group in samples.chunks(group) {
            row.extend(group.iter().map(|v| (v >> low_bits) as u8));
            let low = group.iter().enumerate().fold(0, |low, (i, v)| {
                low | (v & ((1 << low_bits) - 1)) << (low_bits * i)
            });
            row.push(low as u8);
        }
        row
    }

    #[test]
    fn packed_samples_are_those_of_the_mipi_standard() {
        // Four samples 0x3ff, 0x000, 0x155, 0x2aa: high bytes, then low bits from the first up.
        let row = [0xff, 0x00, 0x55, 0xaa, 0b10_01_00_11];
        let mut out = [0; 4];
        TEN.unpack(&row, &mut out);
        assert_eq!(out.map(|v| v >> 6), [0x3ff, 0x000, 0x155, 0x2aa]);
        let mut out = [0; 2];
        TWELVE.unpack(&[0xab, 0x12, 0x3c], &mut out);
        assert_eq!(out.map(|v| v >> 4), [0xabc, 0x123]);
    }

    proptest! {
        /// A sample packed is the sample unpacked, widened by its own high bits, in rows of any length,
        /// with vectors and without.
        #[test]
        fn unpacking_undoes_packing(
            seeds in prop::collection::vec(0u16..4096, 1..30),
            bits in prop_oneof![Just(10u32), Just(12)],
        ) {
            let samples: Vec<u16> = seeds.iter().flat_map(|v| [*v, v ^ 0x5a5, v >> 1, v ^ 0xfff])
                .map(|v| v & ((1 << bits) - 1)).collect();
            let row = pack(&samples, bits);
            let wide: Vec<u16> = samples.iter()
                .map(|v| v << (16 - bits) | v >> (2 * bits - 16)).collect();
            let mut out = vec![0; samples.len()];
            let mut plain = vec![0; samples.len()];
            if bits == 10 {
                TEN.unpack(&row, &mut out);
                let (groups, _) = row.as_chunks::<10>();
                plain.chunks_mut(SAMPLES).zip(groups)
                    .for_each(|(out, group)| out.copy_from_slice(&TEN.words(group)));
            } else {
                TWELVE.unpack(&row, &mut out);
                let (groups, _) = row.as_chunks::<12>();
                plain.chunks_mut(SAMPLES).zip(groups)
                    .for_each(|(out, group)| out.copy_from_slice(&TWELVE.words(group)));
            }
            prop_assert_eq!(&out, &wide);
            let whole = samples.len() / SAMPLES * SAMPLES;
            prop_assert_eq!(&plain[..whole], &wide[..whole]);
        }
    }
}
