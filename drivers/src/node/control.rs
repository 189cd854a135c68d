//! Controls: exposure, gain, flash modes and whatever else a device lets be set.

use super::{Node, Plain, Request, plain, text};
use std::io;
use v4l::{
    sys::{
        V4L2_CTRL_FLAG_DISABLED, V4L2_CTRL_FLAG_INACTIVE, V4L2_CTRL_FLAG_NEXT_CTRL,
        V4L2_CTRL_FLAG_READ_ONLY, v4l2_ext_control, v4l2_ext_controls, v4l2_query_ext_ctrl,
    },
    v4l2::vidioc,
};

/// What kind of value a control takes; kinds that hold more than a number are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A whole number.
    Integer,
    /// 0 or 1.
    Boolean,
    /// The number of an entry.
    Menu,
    /// Something happens when it is set.
    Button,
    /// One bit for each of several facts.
    Bitmask,
}

/// One control as its device describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Control {
    /// `V4L2_CID_…`.
    pub id: u32,
    /// The device's name for it.
    pub name: String,
    /// What it takes.
    pub kind: Kind,
    /// Least value.
    pub least: i64,
    /// Greatest value.
    pub greatest: i64,
    /// Distance between two values, ≥ 1.
    pub step: i64,
    /// Cannot be set, for now or at all.
    pub fixed: bool,
}

impl Control {
    /// Its name as `v4l2-ctl` writes it: lower case, one `_` for each run of other characters.
    pub fn key(&self) -> String {
        let words: Vec<String> = self
            .name
            .split(|c: char| !c.is_ascii_alphanumeric())
            .filter(|word| !word.is_empty())
            .map(str::to_ascii_lowercase)
            .collect();
        words.join("_")
    }

    /// The value nearest to `wanted` that may be set.
    pub fn nearest(&self, wanted: i64) -> i64 {
        let inside = wanted.clamp(self.least, self.greatest);
        let steps = (inside - self.least + self.step / 2) / self.step;
        (self.least + steps * self.step).min(self.greatest)
    }
}

plain!(v4l2_query_ext_ctrl, v4l2_ext_control, v4l2_ext_controls);

const QUERY: Request<v4l2_query_ext_ctrl> = Request::new(vidioc::VIDIOC_QUERY_EXT_CTRL);
const GET: Request<v4l2_ext_controls> = Request::new(vidioc::VIDIOC_G_EXT_CTRLS);
const SET: Request<v4l2_ext_controls> = Request::new(vidioc::VIDIOC_S_EXT_CTRLS);

/// More controls than this are not asked for: a device that never ends its list is broken.
const MOST: usize = 1024;

impl Node {
    /// The control of this id; `None` where the device has none, or one of a kind without number.
    pub fn control(&self, id: u32) -> Option<Control> {
        self.describe(id).ok().and_then(|raw| control(&raw))
    }

    /// Every control that takes a number.
    pub fn controls(&self) -> Vec<Control> {
        let mut found = Vec::new();
        let mut id = 0;
        for _ in 0..MOST {
            let Ok(raw) = self.describe(id | V4L2_CTRL_FLAG_NEXT_CTRL) else {
                break;
            };
            // Ids must rise, or a list would have no end.
            if raw.id <= id {
                break;
            }
            id = raw.id;
            found.extend(control(&raw));
        }
        found
    }

    fn describe(&self, id: u32) -> io::Result<v4l2_query_ext_ctrl> {
        let mut raw = v4l2_query_ext_ctrl {
            id,
            ..Plain::zero()
        };
        // SAFETY: the type holds no pointers.
        unsafe { self.request(&QUERY, &mut raw)? };
        Ok(raw)
    }

    /// Reads one control.
    pub fn value(&self, control: &Control) -> io::Result<i64> {
        self.exchange(&GET, control, 0)
    }

    /// Sets one control and reads back what the device made of it. A button answers 0.
    pub fn set(&self, control: &Control, value: i64) -> io::Result<i64> {
        self.exchange(&SET, control, value)?;
        if control.kind == Kind::Button {
            return Ok(0);
        }
        self.value(control)
    }

    fn exchange(
        &self,
        request: &Request<v4l2_ext_controls>,
        control: &Control,
        value: i64,
    ) -> io::Result<i64> {
        // Only integers wider than 32 bits use the wide field, and `control()` lets none through.
        let narrow = i32::try_from(value).map_err(|_| io::ErrorKind::InvalidInput)?;
        let mut one = v4l2_ext_control {
            id: control.id,
            ..Plain::zero()
        };
        one.__bindgen_anon_1.value = narrow;
        // `which` stays 0, V4L2_CTRL_WHICH_CUR_VAL: controls of any class.
        let mut all = v4l2_ext_controls {
            count: 1,
            controls: &mut one,
            ..Plain::zero()
        };
        // SAFETY: `controls` points to the one control that `count` says, alive until after the
        // call and used by nobody else; its own value is a number (size 0), no pointer.
        unsafe { self.request(request, &mut all)? };
        // SAFETY: every kind let through by `control()` is a 32-bit value, and all bits were set.
        let value = unsafe { one.__bindgen_anon_1.value };
        Ok(match control.kind {
            // A bitmask has no sign.
            Kind::Bitmask => i64::from(value as u32),
            _ => i64::from(value),
        })
    }
}

fn control(raw: &v4l2_query_ext_ctrl) -> Option<Control> {
    let kind = match raw.type_ {
        1 => Kind::Integer,
        2 => Kind::Boolean,
        3 | 9 => Kind::Menu,
        4 => Kind::Button,
        8 => Kind::Bitmask,
        _ => return None,
    };
    if raw.flags & V4L2_CTRL_FLAG_DISABLED != 0 || raw.minimum > raw.maximum {
        return None;
    }
    Some(Control {
        id: raw.id,
        name: text(&raw.name.map(|c| c as u8)),
        kind,
        least: raw.minimum,
        greatest: raw.maximum,
        step: i64::try_from(raw.step).unwrap_or(1).max(1),
        fixed: raw.flags & (V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_INACTIVE) != 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_written_as_v4l2_ctl_writes_them() {
        let named = |name: &str| Control {
            id: 1,
            name: name.into(),
            kind: Kind::Integer,
            least: 0,
            greatest: 1,
            step: 1,
            fixed: false,
        };
        assert_eq!(
            named("White Balance, Automatic").key(),
            "white_balance_automatic"
        );
        assert_eq!(
            named("Exposure Time, Absolute ").key(),
            "exposure_time_absolute"
        );
    }

    #[test]
    fn the_nearest_value_keeps_range_and_step() {
        let control = Control {
            id: 1,
            name: "exposure".into(),
            kind: Kind::Integer,
            least: 3,
            greatest: 20,
            step: 5,
            fixed: false,
        };
        for (wanted, nearest) in [(-9, 3), (5, 3), (6, 8), (13, 13), (99, 18), (i64::MAX, 18)] {
            assert_eq!(control.nearest(wanted), nearest, "{wanted}");
        }
    }
}
