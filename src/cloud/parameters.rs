//! Derivatives by what the model says of bodies, joints, geoms and actuators, where that can differ from world to world.

use std::sync::atomic::AtomicBool;

use lanesim_kernels::integration::difference;

use super::points::{Found, How, width};
use super::{Of, Points, Target};
use crate::error::Error;
use crate::memory;
use crate::model::Model;
use crate::parameters::Parameter;
use crate::rows::{Rows, Strided, Values};
use crate::worlds::Worlds;

/// Derivatives by numbers of a parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ByParameter {
    /// `[nworld, m, n]`: of next states by differences in the tangent space, `nv`, then velocities, activations and sensors; of accelerations; of
    /// forces. NaN where nothing follows.
    pub slopes: Vec<f64>,
    /// How each number was moved: 2 to both sides, 1 forward, 0 not at all, as masses that are zero cannot be, `[n]`.
    pub sides: Vec<f64>,
    /// Bits of [`Status`](crate::status::Status): what happened to the worlds, `[nworld]`.
    pub status: Vec<f64>,
}

/// By which numbers, and how far they are moved: by `eps` times their size, and by `eps` where they are zero. What may not be negative is
/// moved forward only if it is zero.
#[derive(Clone, Copy, Debug)]
pub struct Numbers<'a> {
    /// The parameter.
    pub parameter: Parameter,
    /// Places in its array; each world's number is moved.
    pub entries: &'a [usize],
    /// The share.
    pub eps: f64,
}

impl Worlds {
    /// Derivatives of what follows from the worlds' present states by numbers of the model, centred. States and parameters are what
    /// they were when it is done. What follows from masses takes long where worlds are many. `cancel`: turns true when nobody waits any more.
    ///
    /// ```
    /// use lanesim::cloud::{How, Numbers, Solving, Target};
    /// use lanesim::{Model, Options, Parameter, Worlds};
    ///
    /// let xml = "<mujoco><worldbody><body><joint type='slide' axis='0 0 1'/><geom size='.1'/></body></worldbody></mujoco>";
    /// let model = Model::from_xml_string(xml, &Default::default())?;
    /// let mut worlds = Worlds::new(&model, 1, &Options::default())?;
    /// let numbers = Numbers { parameter: Parameter::Gravity, entries: &[0, 2], eps: 1e-6 };
    /// let how = How { solving: Solving::FixedWork, ..How::default() };
    /// let found = worlds.by_parameter(&Target::Acceleration, &numbers, &how, None)?;
    /// assert!(found.slopes[0].abs() < 1e-9 && (found.slopes[1] - 1.0).abs() < 1e-9);
    /// # Ok::<(), lanesim::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// If the parameter has no such number, or cannot vary; as of [`points_into`](Worlds::points_into).
    pub fn by_parameter(
        &mut self,
        target: &Target<'_>,
        numbers: &Numbers<'_>,
        how: &How,
        cancel: Option<&AtomicBool>,
    ) -> Result<ByParameter, Error> {
        let own = numbers.check(&self.model)?;
        let before = self.all_of(numbers.parameter)?;
        let result = self.moved_parameter(target, numbers, &before, how, cancel);
        let rows = Strided { values: Values::F64(&before), offset: 0, stride: own };
        self.set_parameters(numbers.parameter, &rows, None)?;
        result
    }

    /// A parameter of all worlds.
    fn all_of(&self, parameter: Parameter) -> Result<Vec<f64>, Error> {
        let mut all = Vec::new();
        for world in 0..self.nworld() {
            all.extend_from_slice(self.parameter(parameter, world)?);
        }
        Ok(all)
    }

    fn moved_parameter(
        &mut self,
        target: &Target<'_>,
        numbers: &Numbers<'_>,
        before: &[f64],
        how: &How,
        cancel: Option<&AtomicBool>,
    ) -> Result<ByParameter, Error> {
        let Numbers { parameter, entries, eps } = *numbers;
        let (nworld, own, n) = (self.nworld(), parameter.len(&self.model), entries.len());
        let m = width(&target.after(&self.model, &How { tangent: true, ..*how }));
        let room = |width: &[usize]| memory::zeros("the derivatives", width, self.options.max_memory);
        let (mut slopes, mut status) = (room(&[nworld, m, n])?, room(&[nworld])?);
        let mut sides = vec![2.0; n];
        for (k, entry) in entries.iter().enumerate() {
            if fixed(&self.model, parameter, *entry) {
                sides[k] = 0.0;
                continue;
            }
            let values = || (0..nworld).map(|world| before[world * own + entry]);
            let distances: Vec<f64> = values().map(|x| eps * if x == 0.0 { 1.0 } else { x.abs() }).collect();
            let one_sided = !signed(parameter) && values().any(|x| x == 0.0);
            let mut ends = Vec::new();
            for side in [1.0, if one_sided { 0.0 } else { -1.0 }] {
                let mut moved = before.to_vec();
                distances.iter().enumerate().for_each(|(world, x)| moved[world * own + entry] += side * x);
                let rows = Strided { values: Values::F64(&moved), offset: 0, stride: own };
                self.set_parameters_until(parameter, &rows, None, cancel.unwrap_or(&AtomicBool::new(false)))?;
                ends.push(self.after(target, how, &mut status, cancel)?);
            }
            if one_sided {
                sides[k] = 1.0;
            }
            for world in 0..nworld {
                let found = self.slope(target, [&ends[0], &ends[1]], world);
                let distance = distances[world] * if one_sided { 1.0 } else { 2.0 };
                found.iter().enumerate().for_each(|(row, x)| slopes[(world * m + row) * n + k] = x / distance);
            }
        }
        Ok(ByParameter { slopes, sides, status })
    }

    /// What follows from the worlds' states as they are; `status` takes more bits.
    fn after(
        &mut self,
        target: &Target<'_>,
        how: &How,
        status: &mut [f64],
        cancel: Option<&AtomicBool>,
    ) -> Result<Vec<f64>, Error> {
        let mut points = Points::default();
        points.push([]);
        let how = How { tangent: false, ..*how };
        let width = width(&target.after(&self.model, &how));
        let mut after = memory::zeros("the points", &[self.nworld(), width], self.options.max_memory)?;
        let mut bits = vec![0; self.nworld()];
        let none = || Rows::F64(&mut []);
        let found = Found {
            after: Rows::F64(&mut after),
            before: none(),
            changed: none(),
            sides: none(),
            status: Rows::I32(&mut bits),
        };
        self.points_into(target, &points, &how, found, (None, cancel))?;
        status.iter_mut().zip(bits).for_each(|(all, bits)| *all = f64::from(*all as i32 | bits));
        Ok(after)
    }

    /// How a world's two ends differ.
    fn slope(&self, target: &Target<'_>, [plus, minus]: [&[f64]; 2], world: usize) -> Vec<f64> {
        let (tables, width) = (self.model.tables(), plus.len() / self.nworld());
        let [plus, minus] = [plus, minus].map(|end| &end[world * width..(world + 1) * width]);
        let positions = if target.of() == Of::Transition { tables.sizes.nq } else { 0 };
        let mut found = vec![0.0; if positions > 0 { tables.sizes.nv } else { 0 }];
        if positions > 0 {
            difference(tables, &minus[..positions], &plus[..positions], &mut found);
        }
        found.extend(plus[positions..].iter().zip(&minus[positions..]).map(|(plus, minus)| plus - minus));
        found
    }
}

/// Whether a number of the model is that of every world: it has no effect, or is that of a body without mass or inertia, such as the world
/// itself.
fn fixed(model: &Model, parameter: Parameter, entry: usize) -> bool {
    let weightless = || parameter.of(model)[entry] == 0.0;
    !parameter.counts(model, entry) || matches!(parameter, Parameter::BodyMass | Parameter::BodyInertia) && weightless()
}

/// Whether a parameter's numbers may be negative.
fn signed(parameter: Parameter) -> bool {
    use Parameter::{
        ActuatorBiasprm, ActuatorCtrlrange, ActuatorForcerange, ActuatorGainprm, ActuatorGear, GeomMargin, Gravity,
        JntRange, QposSpring, TendonLengthspring, TendonRange,
    };
    matches!(
        parameter,
        Gravity
            | ActuatorGainprm
            | ActuatorBiasprm
            | ActuatorGear
            | ActuatorCtrlrange
            | ActuatorForcerange
            | QposSpring
            | JntRange
            | TendonRange
            | TendonLengthspring
            | GeomMargin
    )
}

impl Numbers<'_> {
    /// Numbers of the parameter; an error if there is none of those that are named.
    fn check(&self, model: &Model) -> Result<usize, Error> {
        let (own, name) = (self.parameter.len(model), self.parameter.name());
        if let Some(entry) = self.entries.iter().find(|entry| **entry >= own) {
            return Err(Error::Input(format!("{name} has {own} numbers; there is no entry {entry}, counted from 0")));
        }
        if !(1e-12..=0.1).contains(&self.eps) {
            return Err(Error::Options(format!("eps is {}; expected a number from 1e-12 to 0.1", self.eps)));
        }
        Ok(own)
    }
}
