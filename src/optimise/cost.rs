//! What a motion costs: sums of weighted residuals, and their quadratic models by the method of Gauss and Newton.

use faer::Mat;
use lanesim_kernels::integration::difference;
use lanesim_kernels::model::JointKind;

use super::tangent;
use crate::error::Error;
use crate::model::{Model, Names};
use crate::spec::{Object, ObjectKind, Sensor, SensorKind};
use crate::suggest;

/// What a term is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Positions of a joint, or of all: differences from the goal in the tangent space, rad or m.
    Qpos(Option<String>),
    /// Velocities of a joint, or of all.
    Qvel(Option<String>),
    /// The control of an actuator, or all.
    Ctrl(Option<String>),
    /// Position of a site, m.
    Site(String),
    /// Position of a body's frame, m.
    Body(String),
    /// Centre of mass of a body and all that it carries, m.
    Com(String),
    /// Numbers of a sensor.
    Sensor(String),
}

impl Quantity {
    /// The kinds, as [`Quantity::parse`] spells them.
    pub const KINDS: [&'static str; 7] = ["qpos", "qvel", "ctrl", "site", "body", "com", "sensor"];

    /// From text: `qpos`, `qvel` or `ctrl`, of all or as `qpos:JOINT`, `qvel:JOINT`, `ctrl:ACTUATOR`; `site:NAME`, `body:NAME`, `com:BODY`,
    /// `sensor:NAME`.
    ///
    /// # Errors
    ///
    /// If it is none of these.
    pub fn parse(text: &str) -> Result<Quantity, Error> {
        let (kind, name) = text.split_once(':').map_or((text, None), |(kind, name)| (kind, Some(name.to_owned())));
        match (kind, name) {
            ("qpos", name) => Ok(Quantity::Qpos(name)),
            ("qvel", name) => Ok(Quantity::Qvel(name)),
            ("ctrl", name) => Ok(Quantity::Ctrl(name)),
            ("site", Some(name)) => Ok(Quantity::Site(name)),
            ("body", Some(name)) => Ok(Quantity::Body(name)),
            ("com", Some(name)) => Ok(Quantity::Com(name)),
            ("sensor", Some(name)) => Ok(Quantity::Sensor(name)),
            (kind, None) if Self::KINDS.contains(&kind) => {
                Err(Error::Unknown(format!("quantity {text:?} lacks a name; write {kind}:NAME")))
            }
            _ => {
                let remedy = suggest::or_list(kind, Self::KINDS);
                Err(Error::Unknown(format!("there is no quantity {text:?}; {remedy}")))
            }
        }
    }

    /// The sensor that measures it, if it is none of the state or the controls and the model has none by that name.
    fn sensor(&self) -> Option<Sensor> {
        let measure = |kind, object, name: &String| Sensor {
            kind,
            object: Some(Object { kind: object, name: name.clone() }),
            ..Sensor::default()
        };
        match self {
            Quantity::Site(name) => Some(measure(SensorKind::FramePos, ObjectKind::Site, name)),
            Quantity::Body(name) => Some(measure(SensorKind::FramePos, ObjectKind::XBody, name)),
            Quantity::Com(name) => Some(measure(SensorKind::SubtreeCom, ObjectKind::Body, name)),
            Quantity::Qpos(_) | Quantity::Qvel(_) | Quantity::Ctrl(_) | Quantity::Sensor(_) => None,
        }
    }
}

impl std::fmt::Display for Quantity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Quantity::Qpos(None) => write!(f, "qpos"),
            Quantity::Qvel(None) => write!(f, "qvel"),
            Quantity::Ctrl(None) => write!(f, "ctrl"),
            Quantity::Qpos(Some(name)) => write!(f, "qpos:{name}"),
            Quantity::Qvel(Some(name)) => write!(f, "qvel:{name}"),
            Quantity::Ctrl(Some(name)) => write!(f, "ctrl:{name}"),
            Quantity::Site(name) => write!(f, "site:{name}"),
            Quantity::Body(name) => write!(f, "body:{name}"),
            Quantity::Com(name) => write!(f, "com:{name}"),
            Quantity::Sensor(name) => write!(f, "sensor:{name}"),
        }
    }
}

/// What a residual r costs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Norm {
    /// ½ r².
    #[default]
    Quadratic,
    /// √(r² + p²) − p: quadratic below the width p, then linear.
    SmoothAbs(f64),
}

impl Norm {
    /// The cost of a residual, its slope, and its curvature.
    fn of(self, r: f64) -> [f64; 3] {
        match self {
            Norm::Quadratic => [0.5 * r * r, r, 1.0],
            Norm::SmoothAbs(p) => {
                let s = (r * r + p * p).sqrt();
                [s - p, r / s, p * p / (s * s * s)]
            }
        }
    }
}

/// A term of a cost: the difference of a quantity from a goal, at some weight.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// What it is about.
    pub quantity: Quantity,
    /// What the quantity should be: as many numbers as it has (of positions `nq`'s, of a joint its own); one for all; none: zeros, and of positions the reference
    /// configuration.
    pub goal: Vec<f64>,
    /// Weight per second of the motion.
    pub running: f64,
    /// Weight at its end.
    pub terminal: f64,
    /// What a residual costs.
    pub norm: Norm,
}

impl Term {
    /// With quadratic cost, from a quantity's text (see [`Quantity::parse`]), a goal, and weights along the way and at the end.
    ///
    /// # Errors
    ///
    /// If there is no such quantity.
    pub fn new(quantity: &str, goal: &[f64], running: f64, terminal: f64) -> Result<Term, Error> {
        let quantity = Quantity::parse(quantity)?;
        Ok(Term { quantity, goal: goal.to_vec(), running, terminal, norm: Norm::Quadratic })
    }
}

/// Where a quantity's numbers are.
#[derive(Clone, Debug)]
enum Place {
    /// Joints, by number, and the first dof's row among the residuals of the term of each.
    Positions(Vec<usize>),
    Velocities(Vec<usize>),
    Controls(Vec<usize>),
    Sensors(Vec<usize>),
}

#[derive(Clone, Debug)]
struct Part {
    place: Place,
    /// Of positions all of `qpos`, else a number for each residual.
    goal: Vec<f64>,
    width: usize,
    running: f64,
    terminal: f64,
    norm: Norm,
}

/// Terms, resolved for a model.
#[derive(Clone, Debug)]
pub struct Cost {
    parts: Vec<Part>,
    /// Number of residuals.
    width: usize,
    sizes: [usize; 3],
    /// Whether any term reads sensors.
    pub(super) senses: bool,
}

/// A state with controls and what sensors show there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point<'a> {
    pub qpos: &'a [f64],
    pub qvel: &'a [f64],
    pub ctrl: &'a [f64],
    pub sensordata: &'a [f64],
}

/// When a cost is due.
#[derive(Clone, Copy, Debug)]
pub(super) enum When {
    /// Along the way, for so many seconds.
    Running(f64),
    /// At the end.
    Terminal,
}

/// A cost's quadratic model, by the state's n numbers and then by controls.
pub(super) struct Quadratic {
    pub gradient: Mat<f64>,
    pub hessian: Mat<f64>,
}

/// The model with sensors for what terms are about, and where each term's begin.
fn with_sensors(model: &Model, terms: &[Term]) -> Result<(Model, Vec<Option<usize>>), Error> {
    let mut spec = model.basis().spec.clone();
    let mut place = |term: &Term| {
        let sensor = term.quantity.sensor()?;
        spec.sensors.push(sensor);
        Some(spec.sensors.len() - 1)
    };
    let places: Vec<_> = terms.iter().map(&mut place).collect();
    if places.iter().all(Option::is_none) {
        return Ok((model.clone(), places));
    }
    Ok((Model::from_spec(&spec)?, places))
}

fn find(names: &Names, kind: &str, name: &str) -> Result<usize, Error> {
    names.id(name).ok_or_else(|| {
        let known: Vec<&str> = names.iter().filter(|name| !name.is_empty()).collect();
        let remedy = suggest::or_list(name, known);
        Error::Unknown(format!("there is no {kind} {name:?}; {remedy}"))
    })
}

impl Cost {
    /// Resolves terms, and adds sensors to the model for what they are about.
    ///
    /// # Errors
    ///
    /// If a name is unknown, a goal has another length, or a number is not finite or a weight negative.
    pub fn new(model: &Model, terms: &[Term]) -> Result<(Model, Cost), Error> {
        let names = model.names();
        for term in terms {
            match &term.quantity {
                Quantity::Site(name) => find(&names.sites, "site", name)?,
                Quantity::Body(name) | Quantity::Com(name) => find(&names.bodies, "body", name)?,
                Quantity::Sensor(name) => find(&names.sensors, "sensor", name)?,
                Quantity::Ctrl(Some(name)) => find(&names.actuators, "actuator", name)?,
                Quantity::Qpos(Some(name)) | Quantity::Qvel(Some(name)) => find(&names.joints, "joint", name)?,
                Quantity::Qpos(None) | Quantity::Qvel(None) | Quantity::Ctrl(None) => 0,
            };
            check_term(term)?;
        }
        let (model, sensors) = with_sensors(model, terms)?;
        let parts = terms.iter().zip(sensors).map(|(term, sensor)| Part::new(&model, term, sensor));
        let parts = parts.collect::<Result<Vec<_>, _>>()?;
        let senses = parts.iter().any(|part| matches!(part.place, Place::Sensors(_)));
        if senses && !model.tables().options.flags.sensor {
            return Err(Error::Options("terms are about sensors, which the flag `sensor` turns off".into()));
        }
        let sizes = &model.tables().sizes;
        let sizes = [sizes.nv, 2 * sizes.nv + sizes.na, sizes.nu];
        let width = parts.iter().map(|part| part.width).sum();
        Ok((model, Cost { parts, width, sizes, senses }))
    }

    fn residuals(&self, model: &Model, at: &Point<'_>) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.width);
        for part in &self.parts {
            part.residuals(model, at, &mut out);
        }
        out
    }

    /// Norm and weight of each residual.
    fn weights(&self, when: When) -> impl Iterator<Item = (Norm, f64)> {
        self.parts.iter().flat_map(move |part| {
            let weight = match when {
                When::Running(seconds) => seconds * part.running,
                When::Terminal => part.terminal,
            };
            std::iter::repeat_n((part.norm, weight), part.width)
        })
    }

    /// The cost; not finite where the state is not.
    pub(super) fn value(&self, model: &Model, at: &Point<'_>, when: When) -> f64 {
        let residuals = self.residuals(model, at);
        // A term that weighs nothing may be infinite.
        let due = residuals.iter().zip(self.weights(when)).filter(|(_, (_, weight))| *weight > 0.0);
        due.map(|(r, (norm, weight))| weight * norm.of(*r)[0]).sum()
    }

    /// Its quadratic model, where sensors have these derivatives by the state, `[nsensordata, n]`, and by controls.
    pub(super) fn quadratic(&self, model: &Model, at: &Point<'_>, (c, d): (&[f64], &[f64]), when: When) -> Quadratic {
        let [_, n, nu] = self.sizes;
        let residuals = self.residuals(model, at);
        let mut rows = Vec::with_capacity(self.width * (n + nu));
        for part in &self.parts {
            part.slopes(model, at, (c, d), &mut rows, self.sizes);
        }
        let slopes = |i: usize| &rows[i * (n + nu)..(i + 1) * (n + nu)];
        let mut gradient = Mat::zeros(n + nu, 1);
        let (mut due, mut curvatures) = (Vec::new(), Vec::new());
        for (i, (norm, weight)) in self.weights(when).enumerate().filter(|(_, (_, weight))| *weight > 0.0) {
            let [_, slope, curvature] = norm.of(residuals[i]);
            for (k, x) in slopes(i).iter().enumerate() {
                gradient[(k, 0)] += weight * slope * x;
            }
            due.push(i);
            curvatures.push(weight * curvature);
        }
        let jacobian = Mat::from_fn(due.len(), n + nu, |row, k| curvatures[row].sqrt() * slopes(due[row])[k]);
        Quadratic { gradient, hessian: jacobian.transpose() * &jacobian }
    }

    /// How far the only term is from its goal: the norm of its residuals.
    pub(super) fn distance(&self, model: &Model, at: &Point<'_>) -> f64 {
        self.residuals(model, at).iter().map(|r| r * r).sum::<f64>().sqrt()
    }
}

fn check_term(term: &Term) -> Result<(), Error> {
    let what = &term.quantity;
    for (name, weight) in [("running", term.running), ("terminal", term.terminal)] {
        if !(weight.is_finite() && weight >= 0.0) {
            return Err(Error::Input(format!("the {name} weight of {what} is {weight}; expected 0 or more")));
        }
    }
    if let Some(x) = term.goal.iter().find(|x| !x.is_finite()) {
        return Err(Error::Input(format!("the goal of {what} holds {x}; every number must be finite")));
    }
    if let Norm::SmoothAbs(p) = term.norm
        && !(p.is_finite() && p > 0.0)
    {
        return Err(Error::Input(format!("the width of the norm of {what} is {p}; expected a number above 0")));
    }
    Ok(())
}

impl Part {
    fn new(model: &Model, term: &Term, sensor: Option<usize>) -> Result<Part, Error> {
        let (names, tables) = (model.names(), model.tables());
        let joints = |name: &Option<String>| -> Result<Vec<usize>, Error> {
            let all = || Ok((0..tables.joints.len()).collect());
            name.as_ref().map_or_else(all, |name| Ok(vec![find(&names.joints, "joint", name)?]))
        };
        let place = match &term.quantity {
            Quantity::Qpos(name) => Place::Positions(joints(name)?),
            Quantity::Qvel(name) => Place::Velocities(joints(name)?.into_iter().flat_map(|j| dofs(model, j)).collect()),
            Quantity::Ctrl(None) => Place::Controls((0..tables.sizes.nu).collect()),
            Quantity::Ctrl(Some(name)) => {
                let actuator = find(&names.actuators, "actuator", name)?;
                let own = |u: &usize| tables.controls[*u].actuator as usize == actuator;
                Place::Controls((0..tables.sizes.nu).filter(own).collect())
            }
            Quantity::Site(name) | Quantity::Body(name) | Quantity::Com(name) | Quantity::Sensor(name) => {
                let known = sensor.or_else(|| names.sensors.id(name)).map(|sensor| tables.sensors[sensor].data.range());
                Place::Sensors(known.unwrap_or_default().collect())
            }
        };
        let width = match &place {
            Place::Positions(joints) => joints.iter().map(|j| dofs(model, *j).len()).sum(),
            Place::Velocities(list) | Place::Controls(list) | Place::Sensors(list) => list.len(),
        };
        let goal = match &place {
            Place::Positions(joints) => position_goal(model, term, joints)?,
            _ if term.goal.len() <= 1 => vec![term.goal.first().copied().unwrap_or(0.0); width],
            _ if term.goal.len() == width => term.goal.clone(),
            _ => return Err(wrong_goal(term, width)),
        };
        Ok(Part { place, goal, width, running: term.running, terminal: term.terminal, norm: term.norm })
    }

    fn residuals(&self, model: &Model, at: &Point<'_>, out: &mut Vec<f64>) {
        let mut differ = |values: &[f64], list: &[usize]| {
            out.extend(list.iter().zip(&self.goal).map(|(i, goal)| values[*i] - goal));
        };
        match &self.place {
            Place::Velocities(list) => differ(at.qvel, list),
            Place::Controls(list) => differ(at.ctrl, list),
            Place::Sensors(list) => differ(at.sensordata, list),
            Place::Positions(joints) => {
                let mut all = vec![0.0; model.tables().sizes.nv];
                difference(model.tables(), &self.goal, at.qpos, &mut all);
                out.extend(joints.iter().flat_map(|j| dofs(model, *j)).map(|dof| all[dof]));
            }
        }
    }

    /// Adds a row of n + nu slopes for each residual.
    fn slopes(
        &self,
        model: &Model,
        at: &Point<'_>,
        (c, d): (&[f64], &[f64]),
        out: &mut Vec<f64>,
        [nv, n, nu]: [usize; 3],
    ) {
        let unit = |out: &mut Vec<f64>, k: usize| out.extend((0..n + nu).map(|i| if i == k { 1.0 } else { 0.0 }));
        match &self.place {
            Place::Velocities(list) => list.iter().for_each(|i| unit(out, nv + i)),
            Place::Controls(list) => list.iter().for_each(|i| unit(out, n + i)),
            Place::Sensors(list) => {
                for i in list {
                    out.extend_from_slice(&c[i * n..(i + 1) * n]);
                    out.extend_from_slice(&d[i * nu..(i + 1) * nu]);
                }
            }
            Place::Positions(joints) => {
                let mut all = vec![0.0; nv];
                difference(model.tables(), &self.goal, at.qpos, &mut all);
                let slopes = tangent::slopes(model, &all);
                for dof in joints.iter().flat_map(|j| dofs(model, *j)) {
                    out.extend((0..n + nu).map(|k| if k < nv { slopes[(dof, k)] } else { 0.0 }));
                }
            }
        }
    }
}

/// The dofs of a joint.
pub(super) fn dofs(model: &Model, joint: usize) -> std::ops::Range<usize> {
    let joint = &model.tables().joints[joint];
    let count = match joint.kind {
        JointKind::Free => 6,
        JointKind::Ball => 3,
        JointKind::Slide | JointKind::Hinge => 1,
    };
    joint.dof as usize..joint.dof as usize + count
}

fn wrong_goal(term: &Term, width: usize) -> Error {
    let (what, given) = (&term.quantity, term.goal.len());
    Error::Input(format!("the goal of {what} has {given} numbers; expected {width}, or one for all, or none"))
}

/// All positions, with those of the joints as the goal has them.
fn position_goal(model: &Model, term: &Term, joints: &[usize]) -> Result<Vec<f64>, Error> {
    let mut all = model.tables().qpos0.clone();
    let width = |j: usize| match model.tables().joints[j].kind {
        JointKind::Free => 7,
        JointKind::Ball => 4,
        JointKind::Slide | JointKind::Hinge => 1,
    };
    let total: usize = joints.iter().map(|j| width(*j)).sum();
    if term.goal.is_empty() {
        return Ok(all);
    }
    if term.goal.len() != total {
        return Err(wrong_goal(term, total));
    }
    let mut given = term.goal.iter();
    for j in joints {
        let joint = &model.tables().joints[*j];
        let at = joint.qpos as usize..joint.qpos as usize + width(*j);
        all[at.clone()].iter_mut().zip(&mut given).for_each(|(to, x)| *to = *x);
        let turn = match joint.kind {
            JointKind::Free => at.start + 3..at.end,
            JointKind::Ball => at,
            JointKind::Slide | JointKind::Hinge => continue,
        };
        let length = all[turn.clone()].iter().map(|x| x * x).sum::<f64>().sqrt();
        if length < 1e-9 {
            let what = &term.quantity;
            return Err(Error::Input(format!(
                "the goal of {what} holds a quaternion of length zero; expected a rotation"
            )));
        }
        all[turn].iter_mut().for_each(|x| *x /= length);
    }
    Ok(all)
}
