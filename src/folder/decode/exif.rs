//! The one thing of EXIF that changes what a pixel's place means: orientation.

/// As stored is upright.
pub(super) const UPRIGHT: u16 = 1;

const ORIENTATION: u16 = 0x0112;
/// The type of a 16-bit number.
const SHORT: u16 = 3;

/// The orientation in a TIFF header as EXIF has it (Exif 2.32, 4.6.4): 1 = upright as stored, 2 to
/// 8 = viewers mirror or turn it. What is not said, or is said wrong, is upright, as viewers have it.
pub(super) fn orientation(tiff: &[u8]) -> u16 {
    found(tiff)
        .filter(|value| (1..=8).contains(value))
        .unwrap_or(UPRIGHT)
}

fn found(tiff: &[u8]) -> Option<u16> {
    let little = match tiff.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return None,
    };
    let short = |at: usize| {
        let bytes = tiff.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if little {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        })
    };
    let long = |at: usize| {
        let (first, second) = (u32::from(short(at)?), u32::from(short(at.checked_add(2)?)?));
        Some(if little {
            second << 16 | first
        } else {
            first << 16 | second
        })
    };
    let directory = usize::try_from(long(4)?).ok()?;
    let entries = usize::from(short(directory)?);
    (0..entries)
        .map_while(|index| directory.checked_add(2 + 12 * index))
        .find(|&entry| short(entry) == Some(ORIENTATION))
        .filter(|&entry| short(entry + 2) == Some(SHORT))
        .and_then(|entry| short(entry + 8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A directory of one width and one orientation, little or big endian.
    fn tiff(little: bool, value: u16) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(if little { b"II*\0" } else { b"MM\0*" });
        let mut shorts = |values: &[u16]| {
            for value in values {
                bytes.extend(if little {
                    value.to_le_bytes()
                } else {
                    value.to_be_bytes()
                });
            }
        };
        let long = |value: u16| if little { [value, 0] } else { [0, value] };
        shorts(&long(8));
        shorts(&[2, 0x0100, SHORT]);
        shorts(&long(1));
        shorts(&[640, 0, ORIENTATION, SHORT]);
        shorts(&long(1));
        shorts(&[value, 0]);
        bytes
    }

    #[test]
    fn orientation_is_read_in_both_byte_orders() {
        for little in [true, false] {
            for value in 1..=8 {
                assert_eq!(orientation(&tiff(little, value)), value);
            }
            assert_eq!(orientation(&tiff(little, 0)), UPRIGHT);
            assert_eq!(orientation(&tiff(little, 9)), UPRIGHT);
        }
    }

    #[test]
    fn a_cut_directory_is_upright_or_said_in_time() {
        let whole = tiff(true, 6);
        for length in 0..whole.len() {
            let found = orientation(&whole[..length]);
            assert!(found == UPRIGHT || (found == 6 && length >= whole.len() - 2));
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_some_orientation(bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
            let mut tiff = b"II*\0".to_vec();
            tiff.extend(bytes);
            prop_assert!((1..=8).contains(&orientation(&tiff)));
        }
    }
}
