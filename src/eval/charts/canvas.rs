//! A chart drawn once and written twice, as PNG and as SVG, with one font for both.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::sync::OnceLock;
use thiserror::Error;

/// The family name of every text: the PNG's glyphs are Hack, bundled with the program; an SVG names
/// the families a viewer may fall back to. All are as wide as each other, so that both look alike.
const FAMILY: &str = "Hack, DejaVu Sans Mono, Menlo, Consolas, monospace";

/// Text and lines.
pub(super) const INK: RGBColor = RGBColor(0x1a, 0x1a, 0x1a);
/// Rings, rules and rows that are missing.
pub(super) const FAINT: RGBColor = RGBColor(0x76, 0x76, 0x76);
/// Grid lines.
pub(super) const HAIR: RGBColor = RGBColor(0xd4, 0xd4, 0xd4);

/// Why a chart could not be drawn.
#[derive(Debug, Error)]
pub enum ChartError {
    /// The picture could not be drawn: a bug of this room.
    #[error("{chart}: cannot be drawn: {problem}; report it with the report.json beside it")]
    Drawing {
        /// Which chart.
        chart: String,
        /// What the backend said.
        problem: String,
    },
}

/// Something that can draw itself on any backend.
pub(super) trait Chart {
    /// `(width, height)` in pixels.
    fn size(&self) -> (u32, u32);

    /// Draws onto a white area of that size.
    fn draw<B: DrawingBackend>(&self, area: &Canvas<B>) -> Drawn<B>;
}

pub(super) type Canvas<B> = DrawingArea<B, Shift>;
pub(super) type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// `STEM.svg` and `STEM.png`: name and contents.
pub(super) fn encode(chart: &impl Chart, stem: &str) -> Result<[(String, Vec<u8>); 2], ChartError> {
    let drawing = |problem: String| ChartError::Drawing {
        chart: stem.to_owned(),
        problem,
    };
    font().map_err(|problem| drawing(problem.to_owned()))?;
    let (width, height) = chart.size();

    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
    draw_on(chart, &area).map_err(|error| drawing(error.to_string()))?;
    drop(area);

    let mut pixels = vec![255; 3 * width as usize * height as usize];
    let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
    draw_on(chart, &area).map_err(|error| drawing(error.to_string()))?;
    drop(area);
    let png = encoded(&pixels, width, height).map_err(|error| drawing(error.to_string()))?;
    Ok([
        (format!("{stem}.svg"), compact(&svg).into_bytes()),
        (format!("{stem}.png"), png),
    ])
}

/// The same picture in half the bytes: the family named once, defaults left out.
fn compact(svg: &str) -> String {
    let family = format!(" font-family=\"{FAMILY}\"");
    let svg = svg.replace(&family, "").replace(" opacity=\"1\"", "");
    let svg = svg.replacen("<svg ", &format!("<svg{family} "), 1);
    svg.replace(">\n", ">").replace("\n</text>", "</text>")
}

fn draw_on<B: DrawingBackend>(chart: &impl Chart, area: &Canvas<B>) -> Drawn<B> {
    area.fill(&WHITE)?;
    chart.draw(area)?;
    area.present()
}

fn encoded(pixels: &[u8], width: u32, height: u32) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(bytes)
}

/// Makes the bundled font known, once.
fn font() -> Result<(), &'static str> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    let done = REGISTERED.get_or_init(|| {
        register_font(
            FAMILY,
            FontStyle::Normal,
            epaint_default_fonts::HACK_REGULAR,
        )
        .is_ok()
    });
    if *done {
        Ok(())
    } else {
        Err("the bundled font is not a font")
    }
}

/// Where a text's corner or middle stands relative to its point.
pub(super) use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width of a letter of the bundled font as a share of the size plotters asks for.
const LETTER: f64 = 1233.0 / 2384.0;

/// A text style: width of a letter in pixels, color, anchor. Whole widths, as the PNG backend puts
/// every letter on a whole pixel and would space them unevenly otherwise.
pub(super) fn text(
    letter_pixels: u32,
    color: RGBColor,
    horizontal: HPos,
    vertical: VPos,
) -> TextStyle<'static> {
    (FAMILY, f64::from(letter_pixels) / LETTER)
        .into_font()
        .color(&color)
        .pos(Pos::new(horizontal, vertical))
}

/// A title or a heading, from its top left corner.
pub(super) fn heading<B: DrawingBackend>(
    area: &Canvas<B>,
    content: &str,
    letter_pixels: u32,
    at: (i32, i32),
) -> Drawn<B> {
    let style = text(letter_pixels, INK, HPos::Left, VPos::Top);
    area.draw_text(content, &style, at)
}

/// Eight colors that stay apart for color-blind eyes (Okabe & Ito 2008, yellow darkened to be seen
/// on white), one per row number; rows that share a number take paler shades of it in turn, the
/// fourth a darker one.
pub(super) fn row_color(label: &str) -> RGBColor {
    const COLORS: [[f64; 3]; 9] = [
        [0.0, 0.0, 0.0],
        [230.0, 159.0, 0.0],
        [0.0, 114.0, 178.0],
        [213.0, 94.0, 0.0],
        [204.0, 121.0, 167.0],
        [86.0, 180.0, 233.0],
        [190.0, 174.0, 0.0],
        [0.0, 158.0, 115.0],
        [120.0, 80.0, 160.0],
    ];
    const PALER: [f64; 4] = [0.0, 0.4, 0.65, -0.5];
    let letters = label.trim_start_matches(|letter: char| letter.is_ascii_digit());
    let number: usize = label[..label.len() - letters.len()].parse().unwrap_or(1);
    let shade = letters.bytes().last().map_or(0, |letter| letter - b'a');
    let pale = PALER[usize::from(shade) % PALER.len()];
    let color = COLORS[number.saturating_sub(1) % COLORS.len()];
    let [red, green, blue] = color.map(|value| {
        let paler = value + pale.max(0.0) * (255.0 - value);
        (paler * (1.0 + pale.min(0.0))).round() as u8
    });
    RGBColor(red, green, blue)
}

/// Viridis (van der Walt & Smith 2015) at `share` in [0, 1]: dark = low, bright = high.
pub(super) fn viridis(share: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 9] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
        [253.0, 231.0, 37.0],
    ];
    let place = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let below = (place as usize).min(STOPS.len() - 2);
    let [red, green, blue] = std::array::from_fn(|channel| {
        let (low, high) = (STOPS[below][channel], STOPS[below + 1][channel]);
        (low + (high - low) * (place - below as f64)).round() as u8
    });
    RGBColor(red, green, blue)
}
