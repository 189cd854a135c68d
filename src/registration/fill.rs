//! Closes gaps.
use super::RegisteredDepth;
use crate::radiometry::LinearImage;
#[derive(Debug, Clone, Default)]
pub(super) struct Gaps {}
impl Gaps {
    pub fn close(
        &mut self,
        _registered: &mut RegisteredDepth,
        _focal: f32,
        _guide: Option<&LinearImage>,
    ) {
    }
}
