//! One node, negotiated: found, opened, asked for a format, and what it granted.

use super::{
    format::{FORMATS, Format},
    plan::CameraPlan,
    unpack::Unpacker,
};
use crate::{
    device::DriverError,
    node::{Asked, Capabilities, FourCc, Node, opening, refused},
};
use std::path::{Path, PathBuf};

/// An open camera that does not stream yet.
#[derive(Debug)]
pub(super) struct Camera {
    pub node: Node,
    pub capabilities: Capabilities,
    pub unpacker: Unpacker,
    /// Seconds from frame to frame, where the device tells.
    pub frame_seconds: Option<f64>,
}

/// Every node that delivers pictures, with what it is, in the order of their numbers.
pub(super) fn nodes() -> Vec<(PathBuf, Capabilities)> {
    let Ok(folder) = std::fs::read_dir("/dev") else {
        return Vec::new();
    };
    let mut numbers: Vec<u32> = folder
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name();
            name.to_str()?.strip_prefix("video")?.parse().ok()
        })
        .collect();
    numbers.sort_unstable();
    numbers
        .into_iter()
        .map(|number| PathBuf::from(format!("/dev/video{number}")))
        .filter_map(|path| {
            let capabilities = Node::open(&path).ok()?.capabilities().ok()??;
            Some((path, capabilities))
        })
        .collect()
}

/// Formats of a node that are understood, in the node's order.
pub(super) fn understood(path: &Path, capabilities: &Capabilities) -> Vec<Format> {
    Node::open(path)
        .map(|node| node.formats(capabilities.multiplanar))
        .unwrap_or_default()
        .into_iter()
        .filter_map(Format::of)
        .collect()
}

/// The path of `card:NAME`, `bus:PLACE` or a path. Nodes keep neither their number over an unplug
/// nor their order over a restart; cards and places do.
fn find(plan: &CameraPlan) -> Result<PathBuf, DriverError> {
    let wanted = plan.node.as_str();
    let by: fn(&Capabilities) -> &str = match wanted.split_once(':') {
        Some(("card", _)) => |capabilities| &capabilities.card,
        Some(("bus", _)) => |capabilities| &capabilities.bus,
        _ => return Ok(PathBuf::from(wanted)),
    };
    let name = wanted.split_once(':').map_or("", |(_, name)| name);
    let all = nodes();
    let code = plan.format.as_deref().map(four_characters);
    let fits = |(path, capabilities): &&(PathBuf, Capabilities)| {
        by(capabilities) == name
            && code.is_none_or(|code| {
                understood(path, capabilities)
                    .iter()
                    .any(|format| format.code == code)
            })
    };
    if let Some((path, _)) = all.iter().find(fits) {
        return Ok(path.clone());
    }
    let there: Vec<String> = all
        .iter()
        .map(|(path, found)| format!("{} ({}, {})", path.display(), found.card, found.bus))
        .collect();
    Err(DriverError::NoDevice {
        address: wanted.to_owned(),
        reason: if there.is_empty() {
            "no camera is plugged in, or none may be opened".into()
        } else {
            format!("cameras are {}", there.join(", "))
        },
    })
}

/// A code written with up to four characters.
fn four_characters(text: &str) -> FourCc {
    let mut code = [b' '; 4];
    code.iter_mut().zip(text.bytes()).for_each(|(c, b)| *c = b);
    FourCc(code)
}

impl Camera {
    /// Opens and negotiates; `depth` asks for a format of one sample per pixel.
    pub fn open(plan: &CameraPlan, depth: bool) -> Result<Self, DriverError> {
        let path = find(plan)?;
        let node = Node::open(&path).map_err(|error| opening(&path, error))?;
        let capabilities = node
            .capabilities()
            .map_err(|error| refused(&path, "asking what it is", error))?
            .ok_or_else(|| DriverError::NoDevice {
                address: path.display().to_string(),
                reason: "it delivers no pictures; name another node of the same device".into(),
            })?;
        let multiplanar = capabilities.multiplanar;
        let setting = |setting, reason: String| DriverError::Setting {
            device: path.display().to_string(),
            setting,
            reason,
        };
        let offered = node.formats(multiplanar);
        let format = choose(plan.format.as_deref(), &offered, depth)
            .map_err(|reason| setting("format", reason))?;
        let now = node
            .format(multiplanar)
            .map_err(|error| refused(&path, "asking for its format", error))?;
        let asked = Asked {
            format: format.code,
            width: plan.width.unwrap_or(now.width as u32),
            height: plan.height.unwrap_or(now.height as u32),
        };
        let granted = node
            .set_format(multiplanar, asked)
            .map_err(|error| refused(&path, "setting the format", error))?;
        if granted.format != format.code {
            let reason = format!("{} was asked for, {} granted", format.code, granted.format);
            return Err(setting("format", reason));
        }
        if plan.width.is_some()
            && (granted.width, granted.height) != (asked.width as usize, asked.height as usize)
        {
            let sizes: Vec<String> = node
                .sizes(format.code)
                .iter()
                .map(|(w, h)| format!("{w}×{h}"))
                .collect();
            return Err(setting(
                "width",
                format!(
                    "{}×{} was asked for, {}×{} granted; in {} it offers {}",
                    asked.width,
                    asked.height,
                    granted.width,
                    granted.height,
                    format.code,
                    sizes.join(", ")
                ),
            ));
        }
        format
            .check(&granted)
            .map_err(|problem| DriverError::Malformed {
                path: path.clone(),
                problem: format!("it grants {problem}"),
                remedy: "ask for another size or format; this one cannot be what it claims",
            })?;
        let asked_seconds = plan.frames_per_second.map(f64::recip);
        let frame_seconds = node.frame_time(multiplanar, asked_seconds);
        Ok(Self {
            node,
            capabilities,
            unpacker: Unpacker::new(format, granted),
            frame_seconds,
        })
    }

    /// `(width, height)` granted.
    pub fn size(&self) -> (usize, usize) {
        (self.unpacker.granted.width, self.unpacker.granted.height)
    }
}

/// The format to ask for.
fn choose(wanted: Option<&str>, offered: &[FourCc], depth: bool) -> Result<Format, String> {
    let usable = |format: &Format| offered.contains(&format.code) && (!depth || format.is_single());
    let chosen = match wanted {
        Some(code) => Format::of(four_characters(code)).filter(usable),
        None => preferred(depth).find(usable),
    };
    chosen.ok_or_else(|| {
        let list = |codes: Vec<String>| match codes.is_empty() {
            true => "none".to_owned(),
            false => codes.join(", "),
        };
        let known = FORMATS.iter().filter(|format| usable(format));
        let understood = list(known.map(|format| format.code.to_string()).collect());
        format!(
            "{} is not offered, or not understood{}; it offers {}, of which can be used: {understood}",
            wanted.unwrap_or("any format"),
            if depth { " as depth" } else { "" },
            list(offered.iter().map(ToString::to_string).collect()),
        )
    })
}

/// Formats in the order in which they are preferred when none is named: for color those that a
/// webcam delivers at full rate come before gray.
fn preferred(depth: bool) -> impl Iterator<Item = Format> {
    let (gray, color): (Vec<Format>, Vec<Format>) =
        FORMATS.into_iter().partition(|format| format.is_single());
    if depth { gray } else { [color, gray].concat() }.into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(list: &[&str]) -> Vec<FourCc> {
        list.iter().map(|code| four_characters(code)).collect()
    }

    #[test]
    fn the_best_format_that_is_offered_is_chosen() {
        struct Case(&'static [&'static str], bool, &'static str);
        let cases = [
            Case(&["MJPG", "YUYV", "H264"], false, "YUYV"),
            Case(&["GREY", "MJPG"], false, "MJPG"),
            Case(&["YUYV", "RG10"], false, "RG10"),
            Case(&["YUYV", "Y16", "Z16"], true, "Z16"),
            Case(&["GREY"], false, "GREY"),
        ];
        for Case(offered, depth, best) in cases {
            let chosen = choose(None, &codes(offered), depth).unwrap();
            assert_eq!(chosen.code, four_characters(best));
        }
    }

    #[test]
    fn what_is_offered_instead_is_listed() {
        let refused = choose(Some("Z16"), &codes(&["YUYV", "H264", "Y16"]), true).unwrap_err();
        assert!(refused.contains("offers YUYV, H264, Y16"), "{refused}");
        assert!(refused.ends_with("can be used: Y16"), "{refused}");
        let refused = choose(Some("YUYV"), &codes(&["YUYV"]), true).unwrap_err();
        assert!(refused.contains("as depth"), "{refused}");
        assert!(
            choose(None, &[], false)
                .unwrap_err()
                .contains("offers none")
        );
    }
}
