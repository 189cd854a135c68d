//! The `key=value` part of a device address, read so that a mistake says what would be right.

use std::str::FromStr;

/// One option: its name and what it does, with the default.
pub(crate) type Known = (&'static str, &'static str);

/// Splits `key=value` pairs at `separator` and checks each key.
pub(crate) fn pairs<'a>(
    text: &'a str,
    separator: char,
    known: &[Known],
) -> Result<Vec<(&'a str, &'a str)>, String> {
    let mut found: Vec<(&str, &str)> = Vec::new();
    for pair in text.split(separator).filter(|pair| !pair.is_empty()) {
        let Some((key, value)) = pair.split_once('=') else {
            return Err(format!("{pair:?} is no key=value; {}", valid(known)));
        };
        if !known.iter().any(|(name, _)| *name == key) {
            return Err(format!("unknown option {key:?}; {}", valid(known)));
        }
        if found.iter().any(|(name, _)| *name == key) {
            return Err(format!("option {key:?} is given twice"));
        }
        found.push((key, value));
    }
    Ok(found)
}

fn valid(known: &[Known]) -> String {
    let list: Vec<String> = known
        .iter()
        .map(|(name, what)| format!("{name} ({what})"))
        .collect();
    format!("valid options are {}", list.join(", "))
}

/// A number within a range.
pub(crate) fn number<T: FromStr + PartialOrd + std::fmt::Display>(
    key: &str,
    value: &str,
    range: std::ops::RangeInclusive<T>,
) -> Result<T, String> {
    match value.parse::<T>() {
        Ok(number) if range.contains(&number) => Ok(number),
        _ => Err(format!(
            "{key}={value}: a number from {} to {}",
            range.start(),
            range.end()
        )),
    }
}

/// One of a list of names.
pub(crate) fn choice<T: Copy>(key: &str, value: &str, names: &[(&str, T)]) -> Result<T, String> {
    names
        .iter()
        .find(|(name, _)| *name == value)
        .map(|(_, choice)| *choice)
        .ok_or_else(|| {
            let names: Vec<&str> = names.iter().map(|(name, _)| *name).collect();
            format!("{key}={value}: one of {}", names.join(", "))
        })
}
