//! Result + truth → numbers and charts.

mod bench;
pub mod charts;
mod cost;
mod evaluation;
mod grid;
mod light_error;
pub mod methods;
mod photometric;
mod regions;
pub mod report;
mod report_folder;
mod shadow_error;
mod ssim;
mod surface_error;
mod table;

pub use cost::Cost;
pub use evaluation::{EvalError, EvalOptions, Progress, evaluate};
pub use light_error::{Decibel, GridMismatch, LightError, ScaleFit, light_error};
pub use regions::{Region, RegionError, band_pixels};
pub use report::Report;
pub use report_folder::{ReportError, ReportFolder};
pub use shadow_error::{ShadowError, ShadowTally};
pub use surface_error::{NormalError, RoughnessError, normal_error, roughness_error};

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod report_tests;
