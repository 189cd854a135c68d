//! What is told about a flash: which one, how it is driven, and what it may do.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// How a flash is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Nothing is driven: a person or a studio flashes, and brightness alone tells which frames were
    /// lit. Pictures that the camera compresses are all taken for ambient.
    #[default]
    None,
    /// A V4L2 flash subdevice, `/dev/v4l-subdevN`.
    Subdevice,
    /// An LED in `/sys/class/leds`, by `flash_strobe` where it has one, else by `brightness`.
    Led,
    /// A line of a GPIO character device.
    Gpio,
    /// A control of the camera itself, or of any other V4L2 node.
    Control,
}

/// Short and bright, or steady.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// One timed pulse.
    #[default]
    Strobe,
    /// Lit until put out.
    Torch,
}

/// The `[flash]` table of a camera file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Plan {
    /// How it is driven.
    pub kind: Kind,
    /// Subdevice or video node, LED name or folder, or GPIO chip. Without it: the one flash in the
    /// media controller, or the color camera's node.
    pub node: Option<PathBuf>,
    /// Strobe or torch, for lamps that have both.
    pub mode: Mode,
    /// Brightness in the lamp's own unit (µA for most subdevices); `None` = as it is set.
    pub intensity: Option<i64>,
    /// The sensor's strobe output fires it; the driver only arms it.
    pub external: bool,
    /// Name of the control, as `v4l2-ctl -L` shows it, for `kind = "control"`.
    pub control: Option<String>,
    /// Values of that control with light and without.
    pub on: i64,
    /// As [`Self::on`].
    pub off: i64,
    /// Number of the GPIO line.
    pub line: u32,
    /// The line is low when the lamp is lit.
    pub active_low: bool,
    /// Longest time it may be lit at once, seconds in (0, 10]; light that stays longer than this is
    /// the room's where nothing is driven.
    pub longest_seconds: f64,
    /// Largest part of any `window_seconds` that it may be lit, in (0, 1].
    pub duty: f64,
    /// See [`Self::duty`]; seconds in (0, 600].
    pub window_seconds: f64,
    /// From the command until light may still be changing, seconds in [0, 2]. A camera's control
    /// takes effect frames later; an LED at once.
    pub latency_seconds: f64,
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            kind: Kind::None,
            node: None,
            mode: Mode::Strobe,
            intensity: None,
            external: false,
            control: None,
            on: 1,
            off: 0,
            line: 0,
            active_low: false,
            longest_seconds: 0.5,
            duty: 0.5,
            window_seconds: 10.0,
            latency_seconds: 0.001,
        }
    }
}

impl Plan {
    /// Checks every range.
    ///
    /// # Errors
    /// A sentence with the key, what it is and what it may be.
    pub fn check(&self) -> Result<(), String> {
        let within = |key: &str, value: f64, above: f64, most: f64| {
            if value > above && value <= most {
                Ok(())
            } else {
                Err(format!(
                    "flash.{key} is {value}; it must be above {above} and at most {most}"
                ))
            }
        };
        within("longest_seconds", self.longest_seconds, 0.0, 10.0)?;
        within("duty", self.duty, 0.0, 1.0)?;
        within("window_seconds", self.window_seconds, 0.0, 600.0)?;
        // −1e-9 lets zero in.
        within("latency_seconds", self.latency_seconds, -1e-9, 2.0)?;
        if self.longest_seconds > self.duty * self.window_seconds {
            return Err(format!(
                "flash.longest_seconds is {}, more than flash.duty allows in flash.window_seconds \
                 ({} s); raise the one or lower the other",
                self.longest_seconds,
                self.duty * self.window_seconds
            ));
        }
        if self.kind == Kind::Control && self.control.is_none() {
            return Err("flash.control is missing; name the camera's control".into());
        }
        if matches!(self.kind, Kind::Led | Kind::Gpio) && self.node.is_none() {
            return Err("flash.node is missing; name the LED or the GPIO chip".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_that_make_no_sense_are_named() {
        let good = Plan {
            kind: Kind::Gpio,
            node: Some("/dev/gpiochip0".into()),
            ..Plan::default()
        };
        assert_eq!(good.check(), Ok(()));
        struct Case(&'static str, fn(&mut Plan));
        let cases = [
            Case("longest_seconds", |plan| plan.longest_seconds = f64::NAN),
            Case("duty", |plan| plan.duty = 0.0),
            Case("window_seconds", |plan| plan.window_seconds = 1e9),
            Case("latency_seconds", |plan| plan.latency_seconds = -1.0),
            Case("longest_seconds", |plan| plan.window_seconds = 0.1),
            Case("node", |plan| plan.node = None),
        ];
        for Case(key, spoil) in cases {
            let mut plan = good.clone();
            spoil(&mut plan);
            let message = plan.check().unwrap_err();
            assert!(message.contains(key), "{message}");
        }
    }
}
