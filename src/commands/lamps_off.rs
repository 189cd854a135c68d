//! `lamps-off`: every lamp with a flash driver goes out, whatever left it on.

use super::{Answer, CommandError, error::ResultError};
use std::path::Path;

/// Where the kernel shows lamps.
const LAMPS: &str = "/sys/class/leds";

pub(super) fn run() -> Result<Answer, CommandError> {
    lamps_off(Path::new(LAMPS))
}

/// Switches off what is under `folder`: first the strobe, then the torch.
fn lamps_off(folder: &Path) -> Result<Answer, CommandError> {
    let mut off = Vec::new();
    let mut failed = None;
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for lamp in entries.map(|entry| entry.path()) {
        // Lamps without it are key lights and disk lights: none of ours.
        if !lamp.join("flash_strobe").exists() {
            continue;
        }
        for switch in ["flash_strobe", "brightness"] {
            let path = lamp.join(switch);
            // One that cannot be switched must not keep the next from going out.
            if let Err(error) = std::fs::write(&path, "0\n") {
                failed = Some(ResultError {
                    path,
                    problem: format!("cannot be switched off: {error}"),
                    remedy: "run as root, or as a member of the group video with the udev rules in place",
                });
            }
        }
        off.push(lamp);
    }
    if let Some(error) = failed {
        return Err(error.into());
    }
    let names: Vec<String> = off.iter().map(|lamp| lamp.display().to_string()).collect();
    let text = match names.len() {
        0 => "no lamp with a flash driver".to_owned(),
        _ => format!("off: {}", names.join(", ")),
    };
    Ok(Answer::new(text, &serde_json::json!({ "off": names })))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flash_lamps_go_out_and_others_stay_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let lamp = |name: &str, files: &[&str]| {
            let lamp = folder.path().join(name);
            std::fs::create_dir(&lamp).unwrap();
            for file in files {
                std::fs::write(lamp.join(file), "1\n").unwrap();
            }
            lamp
        };
        let flash = lamp("white:flash", &["brightness", "flash_strobe"]);
        let key = lamp("capslock", &["brightness"]);
        let answer = lamps_off(folder.path()).unwrap();
        assert!(answer.text.contains("white:flash"), "{}", answer.text);
        let read = |lamp: &Path, file: &str| std::fs::read_to_string(lamp.join(file)).unwrap();
        assert_eq!(read(&flash, "brightness"), "0\n");
        assert_eq!(read(&flash, "flash_strobe"), "0\n");
        assert_eq!(read(&key, "brightness"), "1\n");
        assert!(lamps_off(&folder.path().join("absent")).is_ok());
    }
}
