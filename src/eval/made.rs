//! When and by what a report was made.

use serde::Serialize;
use std::time::SystemTime;

/// When and by what a report was made.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Made {
    /// Date and time of day, UTC, as in `2026-11-25 19:30 UTC`.
    pub at: String,
    /// The command that makes it again; empty where a program called the library.
    pub command: String,
    /// Version of this program.
    pub version: &'static str,
}

impl Made {
    /// Now.
    pub(super) fn now() -> Self {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        Self {
            at: stamp(since.map_or(0, |since| since.as_secs())),
            command: String::new(),
            version: env!("CARGO_PKG_VERSION"),
        }
    }
}

/// Seconds since 1970 as a date: eras of 400 years, years from March on (Hinnant, "chrono-compatible
/// low-level date algorithms", 2013).
fn stamp(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 {
        from_march + 3
    } else {
        from_march - 9
    };
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    let (hour, minute) = (seconds / 3600 % 24, seconds / 60 % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // From `date -u -d @N`.
        for (seconds, date) in [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_399, "2000-02-28 23:59 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (1_740_787_199, "2025-02-28 23:59 UTC"),
            (1_740_787_200, "2025-03-01 00:00 UTC"),
            (1_767_225_599, "2025-12-31 23:59 UTC"),
        ] {
            assert_eq!(stamp(seconds), date);
        }
    }
}
