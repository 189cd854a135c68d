//! A small capture folder, made to measure: a tilted plane and a ball in front of it.

use std::path::Path;

/// Pixels per row and rows of the photographs and of the depth map.
pub const SIZE: (u32, u32) = (64, 48);

/// What to write.
#[derive(Debug, Clone, Copy)]
pub struct Capture {
    /// Flash light of a facing white patch at one metre, in [0, 1]; 0 = no flash signal.
    pub flash: f32,
    /// The room's light in [0, 1].
    pub ambient: f32,
    /// False leaves every depth sample without an answer.
    pub depth: bool,
}

impl Capture {
    /// A capture with nothing wrong.
    pub const GOOD: Self = Self {
        flash: 0.5,
        ambient: 0.1,
        depth: true,
    };

    /// Writes the folder.
    pub fn write(self, folder: &Path) {
        std::fs::create_dir_all(folder).unwrap();
        let (width, height) = SIZE;
        std::fs::write(folder.join("capture.toml"), capture_toml(width, height)).unwrap();
        let metres = |x: u32, y: u32| {
            let (x, y) = (x as f32 - 31.5, y as f32 - 23.5);
            let ball = (144.0 - x * x - y * y).max(0.0).sqrt();
            if ball > 0.0 {
                0.9 - 0.01 * ball
            } else {
                1.2 + 0.002 * x
            }
        };
        // Inverse square and cosine of a surface that faces the camera, seen from the lens.
        let falloff = |x: u32, y: u32| {
            let (u, v) = ((x as f32 - 31.5) / 60.0, (y as f32 - 23.5) / 60.0);
            1.0 / (metres(x, y).powi(2) * (1.0 + u * u + v * v).powf(1.5))
        };
        let photograph = |lamp: f32| {
            image::ImageBuffer::from_fn(width, height, |x, y| {
                let light = self.ambient + lamp * falloff(x, y);
                let color = [light, 0.8 * light, 0.6 * light];
                image::Rgb(color.map(|value| (value.clamp(0.0, 1.0) * 65535.0) as u16))
            })
        };
        photograph(self.flash)
            .save(folder.join("flash.png"))
            .unwrap();
        photograph(0.0).save(folder.join("ambient.png")).unwrap();
        image::ImageBuffer::from_fn(width, height, |x, y| {
            image::Luma([if self.depth {
                (metres(x, y) * 1000.0) as u16
            } else {
                0u16
            }])
        })
        .save(folder.join("depth.png"))
        .unwrap();
    }
}

/// The text of a `capture.toml` for pictures of this size.
pub fn capture_toml(width: u32, height: u32) -> String {
    format!(
        "format = 1\n[color]\nwidth = {width}\nheight = {height}\nfx = 60.0\nfy = 60.0\n\
         cx = {}\ncy = {}\ndistortion = {{ model = \"none\" }}\ntransfer = \"linear\"\n\
         [flash]\nposition_metres = [0.0, 0.0, 0.0]\nintensity = 0.5\n",
        f64::from(width - 1) / 2.0,
        f64::from(height - 1) / 2.0,
    )
}
