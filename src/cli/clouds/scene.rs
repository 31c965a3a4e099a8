//! What clouds are around: a humanoid over 30 time steps, on six points, on four, or in the air.

use lanesim::cloud::{self, Grid, Target};
use lanesim::rows::{Rows, Strided, Values};
use lanesim::{Controls, Field, Model, Options, Rollout, Worlds};

use super::super::failure::Failure;

/// Time steps of a trajectory.
pub const STEPS: usize = 30;
/// Steps after which the humanoid stands quietly.
const SETTLED: usize = 1000;
/// Share of the servos' range by which it is disturbed.
const NOISE: f64 = 0.3;
const XML: &str = include_str!("../../../models/zoo/humanoid18.xml");
/// The points without which two are left under a foot.
const FIFTH_AND_SIXTH: [&str; 2] = [
    r#"<geom name="left_toe_in" class="contact_point" pos="0.135 -0.04 -0.05"/>"#,
    r#"<geom name="right_toe_in" class="contact_point" pos="0.135 0.04 -0.05"/>"#,
];

/// A trajectory.
pub struct Scene {
    /// Contacts that act.
    pub contacts: usize,
    /// The model in MuJoCo's format.
    pub xml: String,
    /// The model, whose constraints are solved until only rounding is left.
    pub model: Model,
    pub qpos: Vec<f64>,
    pub qvel: Vec<f64>,
    pub ctrl: Vec<f64>,
    pub qacc: Vec<f64>,
    /// Contacts that were found in its states, on average.
    pub found: f64,
}

impl Scene {
    /// That with so many contacts.
    pub fn new(contacts: usize) -> Result<Scene, Failure> {
        let xml = match contacts {
            4 => FIFTH_AND_SIXTH.iter().fold(XML.to_owned(), |xml, geom| xml.replace(geom, "")),
            _ => XML.to_owned(),
        };
        let model = cloud::accurate(&Model::from_xml_string(&xml, &Default::default())?)?;
        let mut scene =
            Scene { contacts, xml, model, qpos: vec![], qvel: vec![], ctrl: vec![], qacc: vec![], found: 0.0 };
        scene.walk()?;
        Ok(scene)
    }

    /// Keeps the states of 30 steps under a little control noise.
    fn walk(&mut self) -> Result<(), Failure> {
        let mut worlds = Worlds::new(&self.model, 1, &Options { threads: Some(1), ..Options::default() })?;
        worlds.reset(0, Some(0))?;
        if self.contacts == 0 {
            let mut qpos = worlds.get(Field::Qpos, 0)?;
            qpos[2] += 2.0;
            worlds.set(Field::Qpos, 0, &qpos)?;
        } else {
            worlds.step(SETTLED)?;
        }
        let noise =
            |nstep| Rollout { nstep, controls: Controls::Noise { seed: 1, scale: NOISE }, ..Rollout::default() };
        for _ in 0..STEPS {
            worlds.rollout(&noise(1))?;
            let (mut ncon, mut qacc) = ([0.0], vec![0.0; self.model.tables().sizes.nv]);
            worlds.read_all(&["ncon", "qacc"], vec![Rows::F64(&mut ncon), Rows::F64(&mut qacc)])?;
            self.qpos.extend(worlds.get(Field::Qpos, 0)?);
            self.qvel.extend(worlds.get(Field::Qvel, 0)?);
            self.ctrl.extend(worlds.get(Field::Ctrl, 0)?);
            self.qacc.extend(qacc);
            self.found += ncon[0];
        }
        self.found /= STEPS as f64;
        Ok(())
    }

    /// Of what there are derivatives.
    pub fn target(&self, inverse: bool) -> Target<'_> {
        let stride = self.model.tables().sizes.nv;
        match inverse {
            true => Target::Inverse(Strided { values: Values::F64(&self.qacc), offset: 0, stride }),
            false => Target::Acceleration,
        }
    }

    /// The 52 columns: positions but for where on the floor the humanoid is, which changes nothing, velocities, and generalised forces, or
    /// accelerations of inverse dynamics.
    pub fn columns(&self, inverse: bool) -> Vec<usize> {
        let sizes = &self.model.tables().sizes;
        let drive = 2 * sizes.nv + if inverse { 0 } else { sizes.na + sizes.nu };
        (2..2 * sizes.nv).chain(drive..drive + sizes.nv).collect()
    }

    /// Differences along these.
    pub fn grid(&self, inverse: bool, (eps, centred, second): (f64, bool, bool)) -> Result<Grid, Failure> {
        Ok(Grid::new(&self.model, &self.target(inverse), Some(&self.columns(inverse)), (eps, centred, second))?)
    }

    /// Worlds in its states.
    pub fn worlds(&self, options: &Options) -> Result<Worlds, Failure> {
        let mut worlds = Worlds::new(&self.model, STEPS, options)?;
        for (field, numbers) in [(Field::Qpos, &self.qpos), (Field::Qvel, &self.qvel), (Field::Ctrl, &self.ctrl)] {
            worlds.write_all(field, &Strided::new(Values::F64(numbers), field.len(&self.model)), None)?;
        }
        Ok(worlds)
    }
}
