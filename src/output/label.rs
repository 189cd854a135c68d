//! Words on pictures.

use ab_glyph::{Font as _, FontRef, Glyph, PxScale, ScaleFont as _, point};
use drivers::Plane;

/// Writes `text` in `color` with its top left corner at (x, y), `height` pixels tall; what does not
/// fit on the canvas is cut off.
pub fn draw(
    canvas: &mut Plane<[u8; 3]>,
    (x, y): (usize, usize),
    height: f32,
    color: [u8; 3],
    text: &str,
) {
    let Some(font) = font() else { return };
    let scaled = font.as_scaled(PxScale::from(height));
    for glyph in layout(&font, height, text) {
        let Some(outline) = scaled.font.outline_glyph(glyph) else {
            continue;
        };
        let bounds = outline.px_bounds();
        outline.draw(|dx, dy, coverage| {
            let px = x as f32 + bounds.min.x + dx as f32;
            let py = y as f32 + bounds.min.y + dy as f32;
            if px < 0.0
                || py < 0.0
                || px as usize >= canvas.width()
                || py as usize >= canvas.height()
            {
                return;
            }
            let pixel = &mut canvas[(px as usize, py as usize)];
            let coverage = coverage.clamp(0.0, 1.0);
            for (under, over) in pixel.iter_mut().zip(color) {
                let blend = f32::from(*under) * (1.0 - coverage) + f32::from(over) * coverage;
                *under = blend.round() as u8;
            }
        });
    }
}

/// Width of `text` in pixels when drawn `height` tall.
pub fn width(height: f32, text: &str) -> usize {
    let Some(font) = font() else { return 0 };
    let scaled = font.as_scaled(PxScale::from(height));
    layout(&font, height, text).last().map_or(0, |last| {
        (last.position.x + scaled.h_advance(last.id)).ceil() as usize
    })
}

/// `text`, shortened with an ellipsis until it is at most `pixels` wide.
pub fn fit(height: f32, pixels: usize, text: &str) -> String {
    if width(height, text) <= pixels {
        return text.into();
    }
    let mut kept: Vec<char> = text.chars().collect();
    while kept.pop().is_some() {
        let shorter: String = kept.iter().chain(&['…']).collect();
        if width(height, &shorter) <= pixels {
            return shorter;
        }
    }
    String::new()
}

/// Ubuntu Light (Ubuntu Font Licence), embedded, so that no system font is needed.
fn font() -> Option<FontRef<'static>> {
    FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).ok()
}

fn layout(font: &FontRef<'static>, height: f32, text: &str) -> Vec<Glyph> {
    let scaled = font.as_scaled(PxScale::from(height));
    let mut pen = 0.0;
    let mut previous = None;
    text.chars()
        .map(|letter| {
            let id = scaled.glyph_id(letter);
            if let Some(before) = previous {
                pen += scaled.kern(before, id);
            }
            let glyph = id.with_scale_and_position(height, point(pen, scaled.ascent()));
            pen += scaled.h_advance(id);
            previous = Some(id);
            glyph
        })
        .collect()
}
