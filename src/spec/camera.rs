//! Cameras.

use super::Source;

/// A camera (MJCF `camera`): sensors can be about it.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Name, or empty.
    pub name: String,
    /// Position in the body frame.
    pub pos: [f64; 3],
    /// Orientation in the body frame; it looks along -z, x is to the right.
    pub quat: [f64; 4],
    /// Whether it turns by itself, to track something.
    pub tracking: bool,
    /// Whether rays through its pixels are parallel.
    pub orthographic: bool,
    /// Vertical field of view: degrees, or m if orthographic.
    pub fovy: f64,
    /// Width and height of its picture, pixels.
    pub resolution: [u32; 2],
    /// Width and height of its sensor, m; 0: `fovy` says what it sees.
    pub sensorsize: [f64; 2],
    /// Focal lengths, m; of a camera with a sensor.
    pub focal: [f64; 2],
    /// Where its axis meets the sensor, m, likewise.
    pub principal: [f64; 2],
    /// Where it was written.
    pub source: Source,
}

impl Default for Camera {
    fn default() -> Self {
        Camera {
            name: String::new(),
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            tracking: false,
            orthographic: false,
            fovy: 45.0,
            resolution: [1; 2],
            sensorsize: [0.0; 2],
            focal: [0.01; 2],
            principal: [0.0; 2],
            source: Source::default(),
        }
    }
}

impl Camera {
    /// A length on its sensor in pixels; found in single precision, as MuJoCo does.
    fn pixels(&self, lengths: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| f64::from(lengths[i] as f32 / self.sensorsize[i] as f32 * self.resolution[i] as f32))
    }

    /// Focal lengths in pixels.
    pub(crate) fn lens(&self) -> [f64; 2] {
        let resolution = self.resolution.map(f64::from);
        if self.sensorsize[0] > 0.0 && self.sensorsize[1] > 0.0 {
            return self.pixels(self.focal);
        }
        [0.5 * resolution[1] / (0.5 * self.fovy.to_radians()).tan(); 2]
    }

    /// Where the ray through a pixel starts, and its direction, which is not a unit vector, in the camera's axes. The places are
    /// MuJoCo's: a principal point counts from the picture's corner, and the width of parallel rays is their height.
    pub(crate) fn ray(&self, column: u32, row: u32) -> [[f64; 3]; 2] {
        let pixel = [f64::from(column) + 0.5, f64::from(row) + 0.5];
        let resolution = self.resolution.map(f64::from);
        if self.orthographic {
            let [x, y] = [0, 1].map(|i| (pixel[i] / resolution[i] - 0.5) * self.fovy);
            return [[x, -y, 0.0], [0.0, 0.0, -1.0]];
        }
        let ([across, down], [width, height]) = (self.lens(), self.sensorsize);
        let middle = if width > 0.0 && height > 0.0 {
            self.pixels(self.principal)
        } else {
            resolution.map(|pixels| 0.5 * pixels)
        };
        [[0.0; 3], [(pixel[0] - middle[0]) / across, -(pixel[1] - middle[1]) / down, -1.0]]
    }
}
