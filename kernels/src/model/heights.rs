//! Height fields.

/// Heights over a rectangle. Colliders see them in double precision, whatever the worlds have.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightField {
    /// Half lengths along x and y, m.
    pub half: [f64; 2],
    /// How far the ground reaches below z = 0, m.
    pub base: f64,
    /// Points along y and along x.
    pub size: [usize; 2],
    /// Heights, m: row by row from the least y to the largest, in each from the least x.
    pub heights: Vec<f64>,
}

impl HeightField {
    /// Lengths of a cell along x and y.
    pub fn cell(&self) -> [f64; 2] {
        let [rows, columns] = self.size;
        [2.0 * self.half[0] / (columns - 1) as f64, 2.0 * self.half[1] / (rows - 1) as f64]
    }

    /// A point of the surface.
    pub fn point(&self, row: usize, column: usize) -> [f64; 3] {
        let [x, y] = self.cell();
        let height = self.heights[row * self.size[1] + column];
        [column as f64 * x - self.half[0], row as f64 * y - self.half[1], height]
    }
}
