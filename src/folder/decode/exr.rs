//! OpenEXR: one flat part, scan lines or tiles, half or float, gray or color.

use super::{Gate, ImageError, Samples};
use ::exr::{
    block::{UncompressedBlock, chunk::Chunk, reader::ChunksReader as _},
    meta::{MetaData, attribute::SampleType, header::Header},
};
use drivers::Plane;
use rayon::prelude::*;
use std::{
    io::{BufRead, Seek},
    panic::{AssertUnwindSafe, catch_unwind},
};

/// Compressed blocks held at once; a block of a legitimate file is at most a few MiB.
const BATCH: usize = 16;
/// One uncompressed block (scan lines or tile).
const BLOCK_BYTES: usize = 16 << 20;
/// Channels that are skipped cost time, so a picture may not carry many.
const MAX_CHANNELS: usize = 32;

/// Where each channel of the file goes: 0 = red (or gray), 1, 2; `None` = skipped.
struct Channels {
    targets: Vec<Option<usize>>,
    types: Vec<SampleType>,
    gray: bool,
}

pub(super) fn decode<R: BufRead + Seek>(gate: &Gate<'_>, reader: R) -> Result<Samples, ImageError> {
    let damaged = |error: ::exr::error::Error| gate.malformed(format!("OpenEXR: {error}"));
    let reader = ::exr::block::read(reader, false).map_err(damaged)?;
    let [header] = reader.headers() else {
        return Err(gate.unsupported(
            format!("OpenEXR: {} parts", reader.headers().len()),
            "save the picture as a single-part file",
        ));
    };
    let channels = check(gate, header)?;
    let size = (header.layer_size.0, header.layer_size.1);

    let mut chunks = reader.all_chunks(false).map_err(damaged)?;
    let meta = chunks.meta_data().clone();
    if channels.gray {
        let mut plane = Plane::filled(size.0, size.1, [0.0_f32; 1]);
        fill(gate, &mut chunks, &meta, &channels, &mut plane)?;
        let (width, height) = plane.size();
        let samples = plane
            .into_samples()
            .into_iter()
            .map(|[value]| value)
            .collect();
        Ok(Samples::GrayF32(gate.plane((width, height), samples)?))
    } else {
        let mut plane = Plane::filled(size.0, size.1, [0.0_f32; 3]);
        fill(gate, &mut chunks, &meta, &channels, &mut plane)?;
        Ok(Samples::RgbF32(plane))
    }
}

/// Everything that can be said from the header alone.
fn check(gate: &Gate<'_>, header: &Header) -> Result<Channels, ImageError> {
    gate.admit(header.layer_size.0, header.layer_size.1)?;
    if header.deep {
        return Err(gate.unsupported("OpenEXR: deep data", "flatten the picture before saving"));
    }
    let display = header.shared_attributes.display_window;
    if header.own_attributes.layer_position != display.position || header.layer_size != display.size
    {
        return Err(gate.unsupported(
            "OpenEXR: dataWindow differs from displayWindow",
            "save the whole picture, without cropping",
        ));
    }
    let list = &header.channels.list;
    if list.len() > MAX_CHANNELS {
        return Err(gate.unsupported(
            format!("OpenEXR: channels counts {}", list.len()),
            "save only R, G, B or one channel",
        ));
    }
    if list
        .iter()
        .any(|channel| (channel.sampling.0, channel.sampling.1) != (1, 1))
    {
        return Err(gate.unsupported(
            "OpenEXR: channels are subsampled",
            "save every channel at full resolution",
        ));
    }
    let block = header.max_block_pixel_size();
    let block_bytes = block
        .0
        .saturating_mul(block.1)
        .saturating_mul(header.channels.bytes_per_pixel);
    if block_bytes > BLOCK_BYTES {
        return Err(gate.too_large("a block's size in bytes", block_bytes, BLOCK_BYTES));
    }
    let names: Vec<String> = list
        .iter()
        .map(|channel| channel.name.to_string())
        .collect();
    let at = |name: &str| {
        names
            .iter()
            .position(|found| found.eq_ignore_ascii_case(name))
    };
    let mut targets = vec![None; list.len()];
    let gray = match (at("R"), at("G"), at("B")) {
        (Some(r), Some(g), Some(b)) => {
            targets[r] = Some(0);
            targets[g] = Some(1);
            targets[b] = Some(2);
            false
        }
        _ => {
            // "A" alone is not a picture, unless it is all there is.
            let candidates: Vec<usize> = (0..names.len())
                .filter(|&index| names.len() == 1 || !names[index].eq_ignore_ascii_case("A"))
                .collect();
            let [only] = candidates[..] else {
                return Err(gate.unsupported(
                    format!("OpenEXR: channels are {names:?}"),
                    "save R, G and B, or one channel alone",
                ));
            };
            targets[only] = Some(0);
            true
        }
    };
    let types: Vec<SampleType> = list.iter().map(|channel| channel.sample_type).collect();
    if targets
        .iter()
        .zip(&types)
        .any(|(to, kind)| to.is_some() && *kind == SampleType::U32)
    {
        return Err(gate.unsupported(
            "OpenEXR: a channel holds whole numbers (UINT)",
            "save it as HALF or FLOAT",
        ));
    }
    Ok(Channels {
        targets,
        types,
        gray,
    })
}

/// Decodes all blocks into `plane`, a batch at a time, and sees to it that none is missing.
fn fill<const N: usize>(
    gate: &Gate<'_>,
    chunks: &mut impl Iterator<Item = ::exr::error::Result<Chunk>>,
    meta: &MetaData,
    channels: &Channels,
    plane: &mut Plane<[f32; N]>,
) -> Result<(), ImageError> {
    let damaged = |error: ::exr::error::Error| gate.malformed(format!("OpenEXR: {error}"));
    let (width, height) = plane.size();
    let mut covered = 0_usize;
    let mut seen = std::collections::HashSet::new();
    loop {
        let batch: Vec<Chunk> = chunks
            .by_ref()
            .take(BATCH)
            .collect::<Result<_, _>>()
            .map_err(damaged)?;
        if batch.is_empty() {
            break;
        }
        let blocks: Vec<UncompressedBlock> = batch
            .into_par_iter()
            .map(|chunk| {
                catch_unwind(AssertUnwindSafe(|| {
                    UncompressedBlock::decompress_chunk(chunk, meta, false)
                }))
                .map_err(|_| gate.malformed("OpenEXR: a block cannot be decompressed"))?
                .map_err(damaged)
            })
            .collect::<Result<_, _>>()?;
        for block in blocks {
            let level = block.index.level;
            if (level.0, level.1) != (0, 0) {
                continue;
            }
            let position = block.index.pixel_position;
            if !seen.insert((position.0, position.1)) {
                return Err(gate.malformed(format!(
                    "OpenEXR: the block at ({}, {}) stands there twice",
                    position.0, position.1
                )));
            }
            covered += block.index.pixel_size.0 * block.index.pixel_size.1;
            place(&block, meta, channels, plane)
                .ok_or_else(|| gate.malformed("OpenEXR: a block lies outside the picture"))?;
        }
    }
    if covered != width * height {
        return Err(gate.malformed(format!(
            "OpenEXR: {covered} of {} pixels are there",
            width * height
        )));
    }
    Ok(())
}

fn place<const N: usize>(
    block: &UncompressedBlock,
    meta: &MetaData,
    channels: &Channels,
    plane: &mut Plane<[f32; N]>,
) -> Option<()> {
    let width = plane.width();
    for line in block.lines(&meta.headers.first()?.channels) {
        let index = line.location;
        let Some(target) = *channels.targets.get(index.channel)? else {
            continue;
        };
        let start = index
            .position
            .1
            .checked_mul(width)?
            .checked_add(index.position.0)?;
        if index.position.0.checked_add(index.sample_count)? > width {
            return None;
        }
        let row = plane
            .samples_mut()
            .get_mut(start..start.checked_add(index.sample_count)?)?;
        match channels.types.get(index.channel)? {
            SampleType::F16 => {
                for (pixel, bytes) in row.iter_mut().zip(line.value.chunks_exact(2)) {
                    pixel[target] = half::f16::from_ne_bytes([bytes[0], bytes[1]]).to_f32();
                }
            }
            SampleType::F32 => {
                for (pixel, bytes) in row.iter_mut().zip(line.value.chunks_exact(4)) {
                    pixel[target] = f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
                }
            }
            SampleType::U32 => return None,
        }
    }
    Some(())
}
