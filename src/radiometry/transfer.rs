//! Transfer curves: how a stored value relates to light, both ways.
//!
//! All curves take 0 to 0 and 1 to 1. Outside [0, 1] they go on by their own formula, and below
//! zero by odd symmetry, so that noise around black keeps its sign.

use super::RadiometryError;
use drivers::Transfer;

/// Entries of a measured response.
pub const RESPONSE_ENTRIES: usize = 256;

/// Light → sRGB value (IEC 61966-2-1).
pub fn srgb_encode(light: f32) -> f32 {
    odd(light, |l| {
        if l <= 0.003_130_8 {
            12.92 * l
        } else {
            1.055 * l.powf(1.0 / 2.4) - 0.055
        }
    })
}

/// sRGB value → light (IEC 61966-2-1).
pub fn srgb_decode(value: f32) -> f32 {
    odd(value, |v| {
        if v <= 0.040_45 {
            v / 12.92
        } else {
            ((v + 0.055) / 1.055).powf(2.4)
        }
    })
}

/// Where the two branches of ITU-R BT.709 meet, in light, and the offset that makes them meet
/// smoothly (the rounded 0.018 and 0.099 of the recommendation leave a step; these are the exact
/// figures, as in ITU-R BT.2020 table 4, more digits).
const BT709_BETA: f32 = 0.018_053_97;
const BT709_ALPHA: f32 = 1.099_296_8;

/// Light → BT.709 camera value (ITU-R BT.709-6, item 1.2).
pub fn bt709_encode(light: f32) -> f32 {
    odd(light, |l| {
        if l < BT709_BETA {
            4.5 * l
        } else {
            BT709_ALPHA * l.powf(0.45) - (BT709_ALPHA - 1.0)
        }
    })
}

/// BT.709 camera value → light (ITU-R BT.709-6, item 1.2).
pub fn bt709_decode(value: f32) -> f32 {
    odd(value, |v| {
        if v < 4.5 * BT709_BETA {
            v / 4.5
        } else {
            ((v + (BT709_ALPHA - 1.0)) / BT709_ALPHA).powf(1.0 / 0.45)
        }
    })
}

/// Light → value of a pure power curve, `light^(1/gamma)`.
pub fn gamma_encode(light: f32, gamma: f32) -> f32 {
    odd(light, |l| l.powf(1.0 / gamma))
}

/// Value of a pure power curve → light, `value^gamma`.
pub fn gamma_decode(value: f32, gamma: f32) -> f32 {
    odd(value, |v| v.powf(gamma))
}

/// Light → value of a measured response, linear between its entries; clamped to [0, 1]. Where
/// the response is flat, the middle of the flat part.
pub fn response_encode(light: f32, response: &[f32]) -> f32 {
    if light.is_nan() || response.len() < 2 {
        return f32::NAN;
    }
    let last = response.len() - 1;
    let below = response.partition_point(|&entry| entry < light);
    let upto = response.partition_point(|&entry| entry <= light);
    let position = if upto > below {
        // Entries below..upto hold exactly this light.
        (below + upto - 1) as f32 / 2.0
    } else if below == 0 {
        0.0
    } else if below > last {
        last as f32
    } else {
        let (low, high) = (response[below - 1], response[below]);
        (below - 1) as f32 + (light - low) / (high - low)
    };
    position / last as f32
}

/// Value → light of a measured response, linear between its entries; clamped to [0, 1].
pub fn response_decode(value: f32, response: &[f32]) -> f32 {
    if value.is_nan() || response.len() < 2 {
        return f32::NAN;
    }
    let last = response.len() - 1;
    let position = value.clamp(0.0, 1.0) * last as f32;
    let below = (position as usize).min(last - 1);
    let along = position - below as f32;
    response[below] * (1.0 - along) + response[below + 1] * along
}

/// Light → value by any curve.
pub fn encode(transfer: &Transfer, light: f32) -> f32 {
    match transfer {
        Transfer::Linear => light,
        Transfer::Srgb => srgb_encode(light),
        Transfer::Bt709 => bt709_encode(light),
        Transfer::Gamma(gamma) => gamma_encode(light, *gamma),
        Transfer::Response(response) => response_encode(light, response),
    }
}

/// Value → light by any curve.
pub fn decode(transfer: &Transfer, value: f32) -> f32 {
    match transfer {
        Transfer::Linear => value,
        Transfer::Srgb => srgb_decode(value),
        Transfer::Bt709 => bt709_decode(value),
        Transfer::Gamma(gamma) => gamma_decode(value, *gamma),
        Transfer::Response(response) => response_decode(value, response),
    }
}

/// Slope `d light / d value` at `value` ≥ 0, by central difference over one 8-bit code.
pub fn slope(transfer: &Transfer, value: f32) -> f32 {
    const HALF_CODE: f32 = 0.5 / 255.0;
    match transfer {
        Transfer::Linear => 1.0,
        _ => {
            let (low, high) = ((value - HALF_CODE).max(0.0), (value + HALF_CODE).min(1.0));
            (decode(transfer, high) - decode(transfer, low)) / (high - low).max(HALF_CODE)
        }
    }
}

/// Refuses curves that are no curves.
///
/// # Errors
/// [`RadiometryError::OutOfRange`] for a gamma that is not positive and finite,
/// [`RadiometryError::BadResponse`] for a response that has not 256 entries, leaves [0, 1],
/// falls, or never rises.
pub fn check(transfer: &Transfer) -> Result<(), RadiometryError> {
    match transfer {
        Transfer::Gamma(gamma) if !(gamma.is_finite() && *gamma >= 0.1 && *gamma <= 10.0) => {
            Err(RadiometryError::OutOfRange {
                field: "transfer gamma",
                value: *gamma,
                range: "between 0.1 and 10",
            })
        }
        Transfer::Response(response) => {
            let problem = if response.len() != RESPONSE_ENTRIES {
                "it must have 256 entries"
            } else if !response.iter().all(|entry| (0.0..=1.0).contains(entry)) {
                "every entry must lie in [0, 1]"
            } else if response.windows(2).any(|pair| pair[1] < pair[0]) {
                "it must not fall"
            } else if response[0] == response[RESPONSE_ENTRIES - 1] {
                "it never rises"
            } else {
                return Ok(());
            };
            Err(RadiometryError::BadResponse { problem })
        }
        _ => Ok(()),
    }
}

fn odd(x: f32, curve: impl Fn(f32) -> f32) -> f32 {
    if x < 0.0 { -curve(-x) } else { curve(x) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn curves() -> impl Strategy<Value = Transfer> {
        prop_oneof![
            Just(Transfer::Linear),
            Just(Transfer::Srgb),
            Just(Transfer::Bt709),
            (1.0f32..3.0).prop_map(Transfer::Gamma),
            (1.2f32..3.0).prop_map(|power| {
                Transfer::Response((0..256).map(|i| (i as f32 / 255.0).powf(power)).collect())
            }),
        ]
    }

    proptest! {
        #[test]
        fn encoding_undoes_decoding(curve in curves(), value in 0.0f32..=1.0) {
            let back = encode(&curve, decode(&curve, value));
            // f32 arithmetic through two powers; near black a response has slope ~0.
            prop_assert!((back - value).abs() < 2e-4 || value < 0.01, "{back} is not {value}");
        }

        #[test]
        fn decoding_undoes_encoding(curve in curves(), light in 0.0f32..=1.0) {
            let back = decode(&curve, encode(&curve, light));
            prop_assert!((back - light).abs() < 2e-5, "{back} is not {light}");
        }

        #[test]
        fn every_curve_rises(curve in curves(), low in 0.0f32..0.99, step in 0.005f32..0.01) {
            prop_assert!(decode(&curve, low + step) > decode(&curve, low));
            prop_assert!(encode(&curve, low + step) > encode(&curve, low));
        }
    }

    /// Expected numbers: IEC 61966-2-1 and BT.709 evaluated in double precision by Python.
    #[test]
    fn curves_meet_their_standards() {
        struct Case(Transfer, f32, f32);
        for Case(curve, value, light) in [
            Case(Transfer::Srgb, 0.5, 0.214_041_14),
            Case(Transfer::Srgb, 0.02, 0.001_547_987_6),
            Case(Transfer::Bt709, 0.5, 0.259_719_43),
            Case(Transfer::Bt709, 0.04, 0.008_888_889),
            Case(Transfer::Gamma(2.2), 0.5, 0.217_637_64),
        ] {
            let found = decode(&curve, value);
            assert!(
                (found - light).abs() < 2e-5,
                "{curve:?}({value}) = {found}, not {light}"
            );
        }
    }

    #[test]
    fn noise_below_black_keeps_its_sign() {
        for curve in [Transfer::Srgb, Transfer::Bt709, Transfer::Gamma(2.2)] {
            assert!(decode(&curve, -0.01) < 0.0);
            assert!(encode(&curve, -0.01) < 0.0);
        }
    }

    #[test]
    fn broken_responses_are_refused() {
        let mut falling: Vec<f32> = (0..256).map(|i| i as f32 / 255.0).collect();
        falling[100] = 0.0;
        for bad in [vec![], vec![0.0; 256], vec![f32::NAN; 256], falling] {
            assert!(check(&Transfer::Response(bad)).is_err());
        }
        for gamma in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(check(&Transfer::Gamma(gamma)).is_err());
        }
    }
}
