//! Height fields.

use std::sync::Arc;

use super::Source;

/// A height field that geoms may have as their shape (MJCF `asset/hfield`).
#[derive(Clone, Debug)]
pub struct HeightField {
    /// Name.
    pub name: String,
    /// Half lengths along x and y, the largest height, and how far the ground reaches below z = 0; m.
    pub size: [f64; 4],
    /// Points along y.
    pub rows: usize,
    /// Points along x.
    pub columns: usize,
    /// Heights from 0 to 1, row by row from the least y, in each from the least x.
    pub heights: Arc<[f64]>,
    /// Where it was written.
    pub source: Source,
}
