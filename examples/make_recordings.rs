//! Makes the bundled recordings: `cargo run --example make_recordings -- tests/recordings`.
//!
//! Each is one or two brackets of a synthetic rig in `NAME.mcap`, with the truth of its world beside
//! it in `NAME.truth/`, laid out like the `truth/` of a capture folder.

use captured::{
    output::{Precision, Tone, exr, png},
    radiometry::LinearImage,
};
use drivers::{
    Device, Frame, Settings,
    recording::Writer,
    synthetic::{Options, Synthetic},
};
use glam::Vec3;
use std::{error::Error, fmt::Write as _, fs, path::Path, time::Duration};

struct Bundled {
    name: &'static str,
    options: &'static str,
    brackets: u64,
}

const BUNDLED: [Bundled; 3] = [
    Bundled {
        name: "desk",
        options: "desk?seed=1&pixels=rgb8",
        brackets: 2,
    },
    Bundled {
        name: "statue",
        options: "statue?seed=2&pixels=bayer",
        brackets: 1,
    },
    Bundled {
        name: "wall-720p",
        options: "wall?seed=3&width=1280&height=720&depth_width=224&pixels=mjpg",
        brackets: 1,
    },
];

/// Degrees off the camera's axis: the whole hemisphere, half of it grazing.
const OFF_AXIS: [f32; 8] = [8.0, 25.0, 38.0, 50.0, 60.0, 66.0, 72.0, 78.0];
/// Degrees around it between one light and the next, so that no side is left out (golden angle).
const AROUND: f32 = 137.508;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os()
        .nth(1)
        .ok_or("usage: make_recordings FOLDER")?;
    let folder = Path::new(&folder);
    fs::create_dir_all(folder)?;
    for bundled in &BUNDLED {
        let mut device = Synthetic::new(Options::parse(bundled.options)?);
        let path = folder.join(bundled.name).with_extension("mcap");
        if path.exists() {
            fs::remove_file(&path)?;
        }
        record(&mut device, &path, bundled.brackets)?;
        truth(&device, &folder.join(bundled.name).with_extension("truth"))?;
    }
    Ok(())
}

/// Whole brackets, each with the one depth frame that its shot takes.
fn record(device: &mut Synthetic, path: &Path, brackets: u64) -> Result<(), Box<dyn Error>> {
    let settings = Settings::default();
    let every = u64::from(settings.flash_every);
    let mut writer = Writer::create(path, &device.info(), &device.rig(), &settings)?;
    let mut stream = device.start(&settings)?;
    let mut pushed = 0;
    while pushed < brackets * every {
        let frame = stream.next_frame(Duration::from_secs(1))?;
        match &frame {
            Frame::Depth(depth) if depth.sequence % every != 1 => continue,
            Frame::Depth(_) => writer.push(&frame)?,
            Frame::Color(_) => {
                writer.push(&frame)?;
                pushed += 1;
                if pushed % every == 0 {
                    writer.finish_bracket()?;
                }
            }
        }
    }
    writer.close()?;
    Ok(())
}

fn truth(device: &Synthetic, folder: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    let world = device.world();
    let truth = world.truth();
    let put = |name: &str, bytes: Vec<u8>| fs::write(folder.join(name), bytes);
    // Eight bits and the sRGB curve, or half floats: what the bundled size allows.
    let picture = |light| png::picture(&LinearImage(light), &Tone::absolute());
    put("albedo.png", picture(truth.albedo)?)?;
    let to_people = |n: &Vec3| [n.x, -n.y, -n.z];
    put(
        "normal.exr",
        exr::rgb(&truth.normal.map(to_people), Precision::Half)?,
    )?;
    put("roughness.png", png::fraction(&truth.roughness)?)?;
    put(
        "depth.exr",
        exr::gray(&truth.depth_metres, Precision::Half)?,
    )?;
    let mut lights = String::from("scale = \"known\"\n");
    for (index, off_axis) in OFF_AXIS.iter().enumerate() {
        let (sin, cos) = off_axis.to_radians().sin_cos();
        let (up, right) = (AROUND * index as f32).to_radians().sin_cos();
        // As it is written down, so that the picture is of exactly that light.
        let direction = [sin * right, sin * up, cos].map(|v| (v * 1e4).round() / 1e4);
        let relit = world.relit(Vec3::from_array(direction));
        put(&format!("relit_{index:03}.png"), picture(relit.light)?)?;
        put(
            &format!("shadow_{index:03}.png"),
            png::fraction(&relit.shadow)?,
        )?;
        let [x, y, z] = direction;
        write!(
            lights,
            "\n[[light]]\ndirection = [{x}, {y}, {z}]\nimage = \"relit_{index:03}.png\"\n\
             shadow = \"shadow_{index:03}.png\"\n"
        )?;
    }
    put("lights.toml", lights.into_bytes())?;
    Ok(())
}
