//! `truth/`: what relit pictures and surfaces should have come out as, read when asked for.

use super::{
    FolderError, images,
    toml::{self, Fields, LightsToml, Scale},
};
use crate::radiometry::LinearImage;
use drivers::{Plane, rig_file};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Truth beside a capture; images are decoded when asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// One entry per photographed or rendered light.
    pub lights: Vec<TruthLight>,
    /// False where relit truth is right up to one global scale only.
    pub scale_known: bool,
    /// Size of every truth image: the color grid.
    pub size: (usize, usize),
    albedo: Option<PathBuf>,
    normal: Option<PathBuf>,
    roughness: Option<PathBuf>,
    depth: Option<PathBuf>,
    registered_depth: Option<PathBuf>,
    depth_unit_metres: f64,
}

/// One light of the truth and the pictures taken under it.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthLight {
    /// Unit vector toward the light as people type it: x right, y up, z toward the camera.
    pub toward_person: [f32; 3],
    /// What the picture was multiplied with, red, green, blue; > 0.
    pub intensity: [f32; 3],
    /// The relit picture's file.
    pub image: PathBuf,
    /// The shadow picture's file.
    pub shadow: Option<PathBuf>,
    size: (usize, usize),
}

impl TruthLight {
    /// The same direction in camera axes: x right, y down, z forward.
    pub fn toward_light(&self) -> Vec3 {
        let [x, y, z] = self.toward_person;
        Vec3::new(x, -y, -z)
    }

    /// The relit picture in linear light divided by the light's intensity (NaN = unknown), and the
    /// fraction of the light that arrives (0 = shadow, 1 = lit; data, not sRGB).
    ///
    /// # Errors
    /// [`FolderError::Image`] for a file that cannot be decoded or has another size than the color
    /// grid, [`FolderError::Field`] for a shadow with more than one channel.
    pub fn load(&self) -> Result<(LinearImage, Option<Plane<f32>>), FolderError> {
        let mut relit = images::linear(&self.image, self.size)?;
        if self.intensity != [1.0; 3] {
            for pixel in relit.samples_mut() {
                for (value, scale) in pixel.iter_mut().zip(self.intensity) {
                    *value /= scale;
                }
            }
        }
        let shadow = self
            .shadow
            .as_deref()
            .map(|path| images::data(path, self.size))
            .transpose()?;
        Ok((LinearImage(relit), shadow))
    }
}

impl Truth {
    /// Diffuse albedo, linear; NaN = unknown. `None` when the truth has none.
    ///
    /// # Errors
    /// [`FolderError::Image`] for a file that cannot be decoded or has another size.
    pub fn albedo(&self) -> Result<Option<LinearImage>, FolderError> {
        let plane = self
            .albedo
            .as_deref()
            .map(|path| images::linear(path, self.size));
        Ok(plane.transpose()?.map(LinearImage))
    }

    /// Unit normals in camera axes (x right, y down, z forward), so a surface facing the camera is
    /// (0, 0, −1); NaN = unknown (zero vectors in the file).
    ///
    /// # Errors
    /// As [`Self::albedo`]; [`FolderError::Field`] for a file without three channels.
    pub fn normal(&self) -> Result<Option<Plane<Vec3>>, FolderError> {
        self.normal
            .as_deref()
            .map(|path| images::normals(path, self.size))
            .transpose()
    }

    /// Karis roughness in [0, 1]; data, not sRGB; NaN = unknown.
    ///
    /// # Errors
    /// As [`Self::normal`].
    pub fn roughness(&self) -> Result<Option<Plane<f32>>, FolderError> {
        self.roughness
            .as_deref()
            .map(|path| images::data(path, self.size))
            .transpose()
    }

    /// True depth in metres on the color grid; NaN = no surface.
    ///
    /// # Errors
    /// As [`Self::normal`].
    pub fn depth(&self) -> Result<Option<Plane<f32>>, FolderError> {
        self.metres(self.depth.as_deref())
    }

    /// The vendor's own registration of the depth frame, metres on the color grid; NaN = no answer.
    ///
    /// # Errors
    /// As [`Self::normal`].
    pub fn registered_depth(&self) -> Result<Option<Plane<f32>>, FolderError> {
        self.metres(self.registered_depth.as_deref())
    }

    /// True where a PNG depth counts in steps other than a millimetre, which only `[depth]` of the
    /// folder it lies in can say.
    pub fn has_depth_in_other_steps(&self) -> bool {
        let png = |path: &PathBuf| path.extension().is_some_and(|kind| kind == "png");
        let depths = [&self.depth, &self.registered_depth];
        depths.into_iter().flatten().any(png) && self.depth_unit_metres != rig_file::millimetre()
    }

    fn metres(&self, path: Option<&Path>) -> Result<Option<Plane<f32>>, FolderError> {
        path.map(|path| images::depth(path, self.size, self.depth_unit_metres))
            .transpose()
    }
}

/// Reads a truth folder: `capture/truth`, or `NAME.truth` beside the recording `NAME.mcap`.
///
/// `size` is the color grid; PNG depths are in `depth_unit_metres`. `Ok(None)` when `dir` does not
/// exist.
///
/// # Errors
/// [`FolderError::Toml`] and [`FolderError::Field`] for `lights.toml`, [`FolderError::Missing`]
/// for a picture it names that is not there.
pub fn read_truth(
    dir: &Path,
    size: (usize, usize),
    depth_unit_metres: f64,
) -> Result<Option<Truth>, FolderError> {
    match dir.metadata() {
        Ok(metadata) if metadata.is_dir() => {}
        Ok(_) => {
            return Err(FolderError::Io {
                path: dir.into(),
                source: std::io::Error::from(std::io::ErrorKind::NotADirectory),
            });
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => {
            return Err(FolderError::Io {
                path: dir.into(),
                source,
            });
        }
    }
    let path = dir.join("lights.toml");
    let table: LightsToml = if path.symlink_metadata().is_ok() {
        toml::parse(&path)?
    } else {
        LightsToml::default()
    };
    let scale_known = table.scale == Scale::Known;
    let mut lights = Vec::with_capacity(table.light.len());
    for (index, light) in table.light.into_iter().enumerate() {
        let fields = Fields(&path);
        let at = |key: &str| format!("light[{index}].{key}");
        fields.finite(&at("direction"), &light.direction.map(f64::from))?;
        let toward = Vec3::from_array(light.direction)
            .try_normalize()
            .ok_or_else(|| {
                fields.wrong(
                    &at("direction"),
                    "has no length",
                    "give a vector toward the light",
                )
            })?;
        let intensity = light.intensity.unwrap_or([1.0; 3]);
        for value in intensity {
            fields.positive(&at("intensity"), f64::from(value))?;
        }
        let image = inside(dir, &fields, &at("image"), &light.image)?;
        let shadow = light
            .shadow
            .as_deref()
            .map(|name| inside(dir, &fields, &at("shadow"), name))
            .transpose()?;
        lights.push(TruthLight {
            toward_person: toward.to_array(),
            intensity,
            image,
            shadow,
            size,
        });
    }
    Ok(Some(Truth {
        lights,
        scale_known,
        size,
        albedo: images::find(dir, "albedo", &["png", "exr"])?,
        normal: images::find(dir, "normal", &["exr", "png"])?,
        roughness: images::find(dir, "roughness", &["png", "exr"])?,
        depth: images::find(dir, "depth", &["exr", "png"])?,
        registered_depth: images::find(dir, "registered_depth", &["png", "exr"])?,
        depth_unit_metres,
    }))
}

/// A file that `lights.toml` names: in the truth folder itself, nowhere else.
fn inside(
    dir: &Path,
    fields: &Fields<'_>,
    field: &str,
    name: &str,
) -> Result<PathBuf, FolderError> {
    let mut parts = Path::new(name).components();
    let plain = matches!(
        (parts.next(), parts.next()),
        (Some(std::path::Component::Normal(only)), None) if only == name
    );
    if !plain {
        return Err(fields.wrong(
            field,
            format!("is {name:?}"),
            "name a file in the same folder, without slashes",
        ));
    }
    let path = dir.join(name);
    if !path.is_file() {
        return Err(FolderError::Missing {
            path,
            remedy: format!("add the file, or correct {field} in {}", fields.0.display()),
        });
    }
    Ok(path)
}
