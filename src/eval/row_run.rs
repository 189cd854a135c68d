//! One row on its way through the lights of a capture.

use super::cost::Cost;
use super::light_error::ScaleFit;
use super::methods::Study;
use super::regions::RegionSums;
use super::report::{LightReport, MeanError, RelitReport, RowReport, SceneReport, WorstLight};
use super::roster::Row;
use super::shadow_error::ShadowTally;

/// What a row has answered so far.
pub(super) struct RowRun<'a> {
    pub(super) row: &'a Row,
    pub(super) study: Box<dyn Study + 'a>,
    pub(super) fit: ScaleFit,
    pub(super) milliseconds: Vec<f64>,
    pub(super) lights: Vec<LightReport>,
    pub(super) absent_lights: usize,
    pub(super) shadows: ShadowTally,
    pub(super) regions: RegionSums,
    scale_is_free: bool,
}

impl<'a> RowRun<'a> {
    pub(super) fn new(row: &'a Row, scale_is_free: bool, study: Box<dyn Study + 'a>) -> Self {
        Self {
            row,
            study,
            fit: ScaleFit::default(),
            milliseconds: Vec::new(),
            lights: Vec::new(),
            absent_lights: 0,
            shadows: ShadowTally::default(),
            regions: RegionSums::default(),
            scale_is_free,
        }
    }

    /// Whether its pictures are compared as they are, where the capture's scale is known.
    pub(super) fn scale_is_known(&self, scale_known: bool) -> bool {
        scale_known && !self.scale_is_free
    }

    /// The factor its pictures are multiplied by.
    pub(super) fn scale(&self, scale_known: bool) -> f64 {
        if self.scale_is_known(scale_known) {
            1.0
        } else {
            self.fit.scale()
        }
    }

    /// What it came to; `None` when nothing could be compared.
    pub(super) fn report(self, scale_known: bool, surfaces: SceneReport) -> Option<RowReport> {
        let row = self.row;
        let absent_lights = self.absent_lights;
        let terms = self.study.terms();
        let relit = self.relit(scale_known);
        let compared = relit.is_some() || !surfaces.is_empty();
        compared.then(|| RowReport {
            row: row.number,
            label: row.label.clone(),
            name: row.name.clone(),
            surfaces,
            absent_lights,
            terms,
            relit,
        })
    }

    fn relit(self, scale_known: bool) -> Option<RelitReport> {
        let errors = || self.lights.iter().map(|light| &light.error);
        let worst = self.lights.iter().min_by(|a, b| {
            a.error
                .linear_psnr_db
                .0
                .total_cmp(&b.error.linear_psnr_db.0)
        })?;
        Some(RelitReport {
            scale: self.scale(scale_known),
            mean: MeanError::of_lights(errors())?,
            worst: WorstLight {
                light: worst.light,
                direction: worst.direction,
                linear_psnr_db: worst.error.linear_psnr_db,
                srgb_psnr_db: worst.error.srgb_psnr_db,
            },
            shadow: self.shadows.error(),
            regions: self.regions.errors(),
            relight: Cost::of(self.milliseconds),
            lights: self.lights,
        })
    }
}
