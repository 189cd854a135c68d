//! Result + truth → numbers and charts.

mod auroc;
mod bench;
mod beside;
mod capture_run;
pub mod charts;
mod cost;
mod csv;
mod directions;
mod evaluation;
mod foreign;
mod grid;
pub mod learned;
mod ledger;
mod light_error;
pub mod light_sets;
mod made;
pub mod methods;
mod mse_table;
pub mod ours;
mod page;
mod photometric;
pub mod published;
mod region_means;
mod regions;
pub mod report;
mod report_folder;
pub mod roster;
mod row_run;
mod savings;
mod shadow_error;
mod ssim;
pub mod stability;
pub mod summary;
mod surface_error;
mod table;
pub mod without_flash;

pub use auroc::auroc;
pub use beside::{BesideError, OtherBackend, other_backends};
pub use cost::Cost;
pub use evaluation::{EvalError, EvalOptions, NoisyDepth, Progress, evaluate};
pub use foreign::ForeignRow;
pub use ledger::Ledger;
pub use light_error::{Decibel, GridMismatch, LightError, ScaleFit, light_error};
pub use made::Made;
pub use regions::{Region, RegionError, band_pixels};
pub use report::Report;
pub use report_folder::{Extent, ReportError, ReportFolder};
pub use roster::Roster;
pub use shadow_error::{ShadowError, ShadowTally};
pub use stability::Spoiling;
pub use surface_error::{NormalError, RoughnessError, normal_error, roughness_error};

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod report_tests;
