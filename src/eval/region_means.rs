//! Errors by region, means over captures.

use super::light_error::Decibel;
use super::regions::Region;
use super::report::{CaptureReport, Report};
use super::summary::mean;

/// One row's PSNR in each of [`Region::ALL`], decibel of the mean over captures of the mean squared
/// error in linear light; `None` where no capture has such a place or it was not measured.
pub(super) struct RegionMeans {
    pub(super) label: String,
    pub(super) name: String,
    pub(super) clean: [Option<f64>; Region::ALL.len()],
    pub(super) noisy: [Option<f64>; Region::ALL.len()],
}

/// Of every row that relit something.
pub(super) fn region_means(report: &Report) -> Vec<RegionMeans> {
    let noisy = report.noisy.as_ref().map(|noisy| noisy.captures.as_slice());
    let rows = report.rows.iter().map(|row| RegionMeans {
        label: row.label.clone(),
        name: row.name.clone(),
        clean: means(&report.captures, &row.label),
        noisy: means(noisy.unwrap_or_default(), &row.label),
    });
    let answered = |row: &RegionMeans| row.clean.iter().chain(&row.noisy).any(Option::is_some);
    rows.filter(answered).collect()
}

fn means(captures: &[CaptureReport], label: &str) -> [Option<f64>; Region::ALL.len()] {
    Region::ALL.map(|region| {
        let rows = captures.iter().flat_map(|capture| &capture.rows);
        let relit = rows
            .filter(|row| row.label == label)
            .filter_map(|row| row.relit.as_ref());
        let errors = relit.flat_map(|relit| &relit.regions);
        let mses = errors
            .filter(|error| error.region == region)
            .map(|error| error.linear_mse);
        let decibel = Decibel::from_mse(mean(mses)?).0;
        decibel.is_finite().then_some(decibel)
    })
}
