//! Looking at a shot that was kept: under any light, layer by layer, at once.

use super::{EnvironmentLight, Light};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// `POST /v1/shots/{id}/view`: show a kept shot, and keep nothing of it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ViewRequest {
    /// Lights to show it under, all at once; at most [`ViewRequest::MOST_LIGHTS`].
    pub lights: Vec<Light>,
    /// Light from all around, added to `lights`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<EnvironmentLight>,
    /// What to show.
    pub layer: Layer,
    /// In which bytes.
    pub format: PictureFormat,
    /// How fine.
    pub detail: Detail,
}

impl ViewRequest {
    /// Most lights of one view.
    pub const MOST_LIGHTS: usize = 8;
}

/// What a view shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// The photograph under the lights asked for.
    #[default]
    Relit,
    /// The photograph as the flash lit it.
    Flash,
    /// The room's own light.
    Ambient,
    /// What share of the light each surface sends back.
    Albedo,
    /// Which way each surface faces: red right, green up, blue toward the camera.
    Normals,
    /// 0 = mirror, 1 = chalk.
    Roughness,
    /// Where the lights arrive: white = lit.
    Shadow,
    /// Near = yellow, far = violet.
    Depth,
    /// How far to trust each pixel: white = fully.
    Confidence,
}

/// The bytes of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureFormat {
    /// JPEG; unknown pixels are black.
    #[default]
    Jpeg,
    /// Rows of red, green, blue, alpha as bytes, sRGB; alpha is 0 where a pixel is unknown and 254
    /// where a previewed one is clipped. `x-width` and `x-height` say the size.
    Raw,
}

/// How fine a view is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Detail {
    /// At most 512 × 512 pixels' worth: for a light that is dragged.
    #[default]
    Quick,
    /// The photograph's own size, up to 2.1 megapixels.
    Full,
}

/// `GET /v1/devices/{number}/preview`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, IntoParams)]
#[serde(default, deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PreviewQuery {
    /// In which bytes.
    #[param(inline)]
    pub format: PictureFormat,
    /// The `x-frame` of the last preview that was had: waits for a newer one.
    pub after: u64,
}
