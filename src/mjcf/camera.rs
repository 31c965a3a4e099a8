//! `camera`.

use super::orientation::{Angles, Orientation};
use super::reader::Reader;
use super::report::Report;
use super::tree::Element;
use crate::spec::Camera;

/// Words of `mode`: whether a camera turns by itself.
const MODES: &[(&str, bool)] =
    &[("fixed", false), ("track", true), ("trackcom", true), ("targetbody", true), ("targetbodycom", true)];
/// Words of `projection`: whether rays are parallel.
const PROJECTIONS: &[(&str, bool)] = &[("perspective", false), ("orthographic", true)];

/// A camera as written, or its default.
#[derive(Clone, Debug)]
pub(super) struct RawCamera {
    camera: Camera,
    orientation: Orientation,
    /// Focal lengths and principal point in pixels.
    pixels: [Option<[f64; 2]>; 2],
}

impl Default for RawCamera {
    fn default() -> Self {
        RawCamera { camera: Camera::default(), orientation: Orientation::IDENTITY, pixels: [None; 2] }
    }
}

impl RawCamera {
    /// Reads what a camera and its default have in common.
    pub fn read(&mut self, reader: &mut Reader) {
        let camera = &mut self.camera;
        reader.list("pos", &mut camera.pos);
        reader.orientation(&mut self.orientation);
        reader.keyword("mode", MODES, &mut camera.tracking);
        reader.keyword("projection", PROJECTIONS, &mut camera.orthographic);
        reader.real("fovy", &mut camera.fovy);
        reader.list("sensorsize", &mut camera.sensorsize);
        reader.list("focal", &mut camera.focal);
        reader.list("principal", &mut camera.principal);
        let mut resolution = camera.resolution.map(|n| i32::try_from(n).unwrap_or(i32::MAX));
        reader.integers("resolution", &mut resolution);
        // What is negative has no pixels, which is refused where they are wanted.
        camera.resolution = resolution.map(|n| u32::try_from(n).unwrap_or(0));
        for (name, target) in ["focalpixel", "principalpixel"].into_iter().zip(&mut self.pixels) {
            let mut pixels = [0.0; 2];
            if reader.list(name, &mut pixels) {
                *target = Some(pixels);
            }
        }
    }

    /// The camera in the coordinates of its frame; `None` if its orientation is none, which is reported.
    pub fn finish(self, element: &Element, angles: &Angles, report: &mut Report) -> Option<Camera> {
        let mut camera = self.camera;
        let lengths = |pixels: [f64; 2], camera: &Camera| {
            // In single precision, as MuJoCo has it.
            [0, 1].map(|i| f64::from(pixels[i] as f32 / camera.resolution[i] as f32 * camera.sensorsize[i] as f32))
        };
        let [focal, principal] = self.pixels;
        camera.focal = focal.map_or(camera.focal, |pixels| lengths(pixels, &camera));
        camera.principal = principal.map_or(camera.principal, |pixels| lengths(pixels, &camera));
        camera.name = element.get("name").unwrap_or_default().to_string();
        camera.source = element.source.clone();
        match self.orientation.quat(angles) {
            Ok(quat) => Some(Camera { quat, ..camera }),
            Err(message) => {
                report.error(element, message, "");
                None
            }
        }
    }
}
