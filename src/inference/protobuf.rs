//! Protocol buffers as bytes on the wire: fields one after the other, bounded by the buffer.

use thiserror::Error;

/// Bytes that are no protocol buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("ends or breaks within a field at byte {at} of a message")]
pub struct Broken {
    /// Byte of the message, counted from its start.
    pub at: usize,
}

/// What a field holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Value<'a> {
    /// Wire type 0.
    Number(u64),
    /// Wire type 2: text, bytes, packed numbers or a message.
    Bytes(&'a [u8]),
    /// Wire types 1 and 5, whose contents nobody here asks for.
    Fixed,
}

impl<'a> Value<'a> {
    /// Of a field that is a message or text; empty where it is neither, as decoders skip it then.
    pub(super) fn bytes(self) -> &'a [u8] {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Number(_) | Self::Fixed => &[],
        }
    }
}

/// One field of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field<'a> {
    pub number: u32,
    pub value: Value<'a>,
    /// All of it, with its tag.
    pub raw: &'a [u8],
}

/// The fields of a message, in their order; ends after the first break.
pub(super) struct Fields<'a> {
    message: &'a [u8],
    at: usize,
}

pub(super) fn fields(message: &[u8]) -> Fields<'_> {
    Fields { message, at: 0 }
}

impl<'a> Fields<'a> {
    fn varint(&mut self) -> Option<u64> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = *self.message.get(self.at)?;
            self.at += 1;
            let bits = u64::from(byte & 0x7f);
            // The tenth byte has room for one bit.
            if shift == 63 && bits > 1 {
                return None;
            }
            value |= bits << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    fn take(&mut self, length: u64) -> Option<&'a [u8]> {
        let end = self.at.checked_add(usize::try_from(length).ok()?)?;
        let taken = self.message.get(self.at..end)?;
        self.at = end;
        Some(taken)
    }

    fn field(&mut self) -> Option<Field<'a>> {
        let start = self.at;
        let tag = u32::try_from(self.varint()?).ok()?;
        let value = match tag & 7 {
            0 => Value::Number(self.varint()?),
            1 => self.take(8).map(|_| Value::Fixed)?,
            2 => {
                let length = self.varint()?;
                Value::Bytes(self.take(length)?)
            }
            5 => self.take(4).map(|_| Value::Fixed)?,
            // Groups, which ONNX never had, and what means nothing.
            _ => return None,
        };
        let number = tag >> 3;
        (number > 0).then_some(Field {
            number,
            value,
            raw: &self.message[start..self.at],
        })
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<Field<'a>, Broken>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.at >= self.message.len() {
            return None;
        }
        let start = self.at;
        Some(self.field().ok_or_else(|| {
            self.at = self.message.len();
            Broken { at: start }
        }))
    }
}

/// Appends a number in as few bytes as it needs.
pub(super) fn put_number(out: &mut Vec<u8>, field: u32, value: u64) {
    put_varint(out, u64::from(field) << 3);
    put_varint(out, value);
}

/// Appends text or a message.
pub(super) fn put_bytes(out: &mut Vec<u8>, field: u32, bytes: &[u8]) {
    put_varint(out, u64::from(field) << 3 | 2);
    put_varint(out, bytes.len() as u64);
    out.extend_from_slice(bytes);
}

fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// One field of bytes by itself: what tests build models of.
#[cfg(test)]
pub(super) fn message(field: u32, inner: &[u8]) -> Vec<u8> {
    let mut out = vec![];
    put_bytes(&mut out, field, inner);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_examples_of_the_protocol_buffers_manual_are_read() {
        // https://protobuf.dev/programming-guides/encoding: 08 96 01 is field 1 = 150, 12 07 … is
        // field 2 = "testing".
        let bytes = b"\x08\x96\x01\x12\x07testing";
        let found: Vec<_> = fields(bytes).map(|field| field.unwrap()).collect();
        assert_eq!(found[0].value, Value::Number(150));
        assert_eq!(
            (found[1].number, found[1].value.bytes()),
            (2, &b"testing"[..])
        );
        let mut written = Vec::new();
        put_number(&mut written, 1, 150);
        put_bytes(&mut written, 2, b"testing");
        assert_eq!(written, bytes);
    }

    #[test]
    fn lengths_beyond_the_buffer_and_endless_numbers_are_broken() {
        for bytes in [
            &b"\x12\x08testing"[..],
            b"\x12\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01",
            b"\x08\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff",
            b"\x08",
            b"\x0b",
            b"\x00\x01",
            b"\x09\x01\x02",
        ] {
            let found: Vec<_> = fields(bytes).collect();
            assert_eq!(found, [Err(Broken { at: 0 })], "{bytes:?}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_end_and_whole_fields_give_the_bytes_back(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let found: Vec<_> = fields(&bytes).collect();
            prop_assert!(found.len() <= bytes.len());
            let raw: Vec<u8> = found.iter().flatten().flat_map(|field| field.raw).copied().collect();
            prop_assert!(bytes.starts_with(&raw));
            prop_assert_eq!(raw.len() == bytes.len(), found.iter().all(Result::is_ok));
        }
    }
}
