//! The few parts of the protobuf wire format that Foxglove's image messages need.
//!
//! Written out by hand because the messages are flat and reading must borrow: no field is copied
//! or allocated before its length was checked against the bytes that are there.

const VARINT: u32 = 0;
const FIXED64: u32 = 1;
const LENGTH: u32 = 2;
const FIXED32: u32 = 5;

/// A message being written.
#[derive(Debug, Default)]
pub(super) struct Encoder(Vec<u8>);

impl Encoder {
    pub fn with_capacity(bytes: usize) -> Self {
        Self(Vec::with_capacity(bytes))
    }

    fn raw_varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn key(&mut self, field: u32, kind: u32) {
        self.raw_varint(u64::from(field << 3 | kind));
    }

    pub fn varint(mut self, field: u32, value: u64) -> Self {
        self.key(field, VARINT);
        self.raw_varint(value);
        self
    }

    pub fn fixed32(mut self, field: u32, value: u32) -> Self {
        self.key(field, FIXED32);
        self.0.extend(value.to_le_bytes());
        self
    }

    pub fn double(mut self, field: u32, value: f64) -> Self {
        self.key(field, FIXED64);
        self.0.extend(value.to_le_bytes());
        self
    }

    pub fn bytes(mut self, field: u32, value: &[u8]) -> Self {
        self.key(field, LENGTH);
        self.raw_varint(value.len() as u64);
        self.0.extend(value);
        self
    }

    pub fn string(self, field: u32, value: &str) -> Self {
        self.bytes(field, value.as_bytes())
    }

    pub fn message(self, field: u32, value: Encoder) -> Self {
        self.bytes(field, &value.0)
    }

    pub fn doubles(self, field: u32, values: &[f64]) -> Self {
        let packed: Vec<u8> = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        self.bytes(field, &packed)
    }

    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// A field's value, borrowed from the message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'a> {
    Varint(u64),
    Fixed64(u64),
    Fixed32(u32),
    Bytes(&'a [u8]),
}

/// Walks the fields of a message; `Err` names what is broken, and the walk ends there.
pub(super) struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    pub fn of(message: &'a [u8]) -> Self {
        Self(message)
    }

    fn varint(&mut self) -> Result<u64, &'static str> {
        let mut value = 0u64;
        for place in 0..10 {
            let (&byte, rest) = self.0.split_first().ok_or("a number is cut off")?;
            self.0 = rest;
            value |= u64::from(byte & 0x7f) << (7 * place);
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("a number is longer than 64 bits")
    }

    fn take(&mut self, length: u64) -> Result<&'a [u8], &'static str> {
        let length = usize::try_from(length).map_err(|_| "a length exceeds the message")?;
        let (value, rest) = self
            .0
            .split_at_checked(length)
            .ok_or("a length exceeds the message")?;
        self.0 = rest;
        Ok(value)
    }

    fn field(&mut self) -> Result<(u32, Value<'a>), &'static str> {
        let key = self.varint()?;
        let field = u32::try_from(key >> 3).map_err(|_| "a field number is too large")?;
        let value = match key as u32 & 7 {
            VARINT => Value::Varint(self.varint()?),
            FIXED64 => {
                let bytes = self.take(8)?;
                Value::Fixed64(
                    bytes
                        .try_into()
                        .map(u64::from_le_bytes)
                        .map_err(|_| "cut off")?,
                )
            }
            LENGTH => {
                let length = self.varint()?;
                Value::Bytes(self.take(length)?)
            }
            FIXED32 => {
                let bytes = self.take(4)?;
                Value::Fixed32(
                    bytes
                        .try_into()
                        .map(u32::from_le_bytes)
                        .map_err(|_| "cut off")?,
                )
            }
            _ => return Err("a field has an unknown wire type"),
        };
        Ok((field, value))
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u32, Value<'a>), &'static str>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.0 = &[];
        }
        Some(field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_field_comes_back() {
        let message = Encoder::default()
            .varint(1, u64::MAX)
            .fixed32(2, 7)
            .double(300, 0.5)
            .string(4, "rgb8")
            .finish();
        let fields: Result<Vec<_>, _> = Fields::of(&message).collect();
        let half = 0.5f64.to_bits();
        assert_eq!(
            fields,
            Ok(vec![
                (1, Value::Varint(u64::MAX)),
                (2, Value::Fixed32(7)),
                (300, Value::Fixed64(half)),
                (4, Value::Bytes(b"rgb8")),
            ])
        );
    }

    #[test]
    fn a_lying_length_is_an_error_and_allocates_nothing() {
        let mut message = Encoder::default().string(4, "abc").finish();
        message[1] = 0x7f;
        assert!(Fields::of(&message).any(|field| field.is_err()));
    }
}
