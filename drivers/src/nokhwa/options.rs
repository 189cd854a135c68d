//! What can be chosen about a webcam, and how an address says it.

use crate::address;
use ::nokhwa::utils::FrameFormat;

/// Everything that can be chosen about a webcam.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Which, as the system counts them.
    pub index: u32,
    /// Pixels asked for.
    pub width: u32,
    /// Pixels asked for.
    pub height: u32,
    /// Frames per second asked for.
    pub rate: u32,
    /// Format; the one that is read most readily without.
    pub format: Option<FrameFormat>,
}

/// Formats by their names in an address.
pub(super) const NAMES: [(&str, FrameFormat); 4] = [
    ("YUYV", FrameFormat::YUYV),
    ("NV12", FrameFormat::NV12),
    ("RGB", FrameFormat::RAWRGB),
    ("MJPG", FrameFormat::MJPEG),
];

const KNOWN: [address::Known; 4] = [
    ("width", "pixels, 640"),
    ("height", "pixels, 480"),
    ("rate", "frames per second, 30"),
    (
        "format",
        "YUYV, NV12, RGB or MJPG, the first of them there is",
    ),
];

impl Options {
    /// Reads `INDEX?key=value&key=value`.
    ///
    /// # Errors
    /// A sentence that says what is valid.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (index, rest) = text.split_once('?').unwrap_or((text, ""));
        let mut options = Self {
            index: address::number("camera", index, 0..=255)?,
            width: 640,
            height: 480,
            rate: 30,
            format: None,
        };
        for (key, value) in address::pairs(rest, '&', &KNOWN)? {
            match key {
                "width" => options.width = address::number(key, value, 16..=8192)?,
                "height" => options.height = address::number(key, value, 16..=8192)?,
                "format" => options.format = Some(address::choice(key, value, &NAMES)?),
                _ => options.rate = address::number(key, value, 1..=240)?,
            }
        }
        Ok(options)
    }

    /// The address that these options open.
    pub(super) fn address(&self) -> String {
        let Self {
            index,
            width,
            height,
            rate,
            format,
        } = self;
        let name = NAMES.iter().find(|(_, named)| Some(*named) == *format);
        let format = name.map_or(String::new(), |(name, _)| format!("&format={name}"));
        format!("nokhwa:{index}?width={width}&height={height}&rate={rate}{format}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_say_what_is_valid() {
        for rest in ["", "&format=MJPG"] {
            let address = format!("1?width=1280&height=720&rate=15{rest}");
            let options = Options::parse(&address).unwrap();
            assert_eq!(options.address(), format!("nokhwa:{address}"));
        }
        for (wrong, word) in [
            ("", "camera"),
            ("front", "0 to 255"),
            ("0?width=1", "from 16"),
            ("0?exposure=1", "valid options"),
            ("0?format=H264", "YUYV, NV12, RGB, MJPG"),
        ] {
            let refused = Options::parse(wrong).unwrap_err();
            assert!(refused.contains(word), "{wrong}: {refused}");
        }
    }
}
