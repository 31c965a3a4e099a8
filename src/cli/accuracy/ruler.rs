//! The ruler: energy, momentum and the like from positions and velocities alone, in double precision, by plain recursion over
//! bodies in world coordinates. It shares nothing with the kernels that it judges but the numbers of the compiled model.

use glam::{DQuat, DVec3};
use lanesim::Model;
use lanesim::model::ArrayData;

/// A state at some time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time: f64,
    /// Positions.
    pub qpos: Vec<f64>,
    /// Velocities.
    pub qvel: Vec<f64>,
}

/// A joint, by MuJoCo's conventions.
#[derive(Clone, Copy, Debug)]
struct Joint {
    /// 0 free, 1 ball, 2 slide, 3 hinge.
    kind: i32,
    qpos: usize,
    dof: usize,
    pos: DVec3,
    axis: DVec3,
    reference: f64,
}

#[derive(Clone, Debug)]
struct Body {
    parent: usize,
    pos: DVec3,
    quat: DQuat,
    com: DVec3,
    axes: DQuat,
    mass: f64,
    inertia: DVec3,
    joints: Vec<Joint>,
}

/// A body's motion.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    pos: DVec3,
    quat: DQuat,
    /// Velocity of the frame's origin.
    linear: DVec3,
    angular: DVec3,
}

/// A body's mass in motion.
struct Moving {
    mass: f64,
    com: DVec3,
    velocity: DVec3,
    angular: DVec3,
    /// About its own centre of mass.
    spin: DVec3,
}

/// What measures states of a model.
#[derive(Clone, Debug)]
pub struct Ruler {
    bodies: Vec<Body>,
    sites: Vec<(usize, DVec3, String)>,
    gravity: DVec3,
    armature: Vec<f64>,
    qpos0: Vec<f64>,
}

fn reals(model: &Model, name: &str) -> Vec<f64> {
    match model.array(name).map(|array| &array.data) {
        Some(ArrayData::F64(values)) => values.clone(),
        Some(ArrayData::I32(values)) => values.iter().map(|x| f64::from(*x)).collect(),
        None => Vec::new(),
    }
}

fn vectors(model: &Model, name: &str) -> Vec<DVec3> {
    reals(model, name).chunks_exact(3).map(DVec3::from_slice).collect()
}

fn quaternion(q: &[f64]) -> DQuat {
    DQuat::from_xyzw(q[1], q[2], q[3], q[0]).normalize()
}

fn quaternions(model: &Model, name: &str) -> Vec<DQuat> {
    reals(model, name).chunks_exact(4).map(quaternion).collect()
}

impl Ruler {
    /// Of a compiled model.
    pub fn new(model: &Model) -> Ruler {
        let integers = |name| reals(model, name).into_iter().map(|x| x as usize).collect::<Vec<_>>();
        let (parents, addresses, counts) =
            (integers("body_parentid"), reals(model, "body_jntadr"), integers("body_jntnum"));
        let (pos, quat) = (vectors(model, "body_pos"), quaternions(model, "body_quat"));
        let (com, axes) = (vectors(model, "body_ipos"), quaternions(model, "body_iquat"));
        let (mass, inertia) = (reals(model, "body_mass"), vectors(model, "body_inertia"));
        let (kinds, qposadr, dofadr) = (reals(model, "jnt_type"), integers("jnt_qposadr"), integers("jnt_dofadr"));
        let (jnt_pos, jnt_axis) = (vectors(model, "jnt_pos"), vectors(model, "jnt_axis"));
        let qpos0 = reals(model, "qpos0");
        let joint = |j: usize| Joint {
            kind: kinds[j] as i32,
            qpos: qposadr[j],
            dof: dofadr[j],
            pos: jnt_pos[j],
            axis: jnt_axis[j],
            reference: qpos0[qposadr[j]],
        };
        let body = |b: usize| Body {
            parent: parents[b],
            pos: pos[b],
            quat: quat[b],
            com: com[b],
            axes: axes[b],
            mass: mass[b],
            inertia: inertia[b],
            joints: (0..counts[b]).map(|k| joint(addresses[b] as usize + k)).collect(),
        };
        let sites = integers("site_bodyid").into_iter().zip(vectors(model, "site_pos"));
        let names = model.names().sites.iter().map(str::to_owned);
        Ruler {
            bodies: (0..parents.len()).map(body).collect(),
            sites: sites.zip(names).map(|((body, pos), name)| (body, pos, name)).collect(),
            gravity: DVec3::from_array(model.tables().gravity),
            armature: reals(model, "dof_armature"),
            qpos0,
        }
    }

    fn motions(&self, s: &Sample) -> Vec<Motion> {
        let mut all: Vec<Motion> = Vec::with_capacity(self.bodies.len());
        for (b, body) in self.bodies.iter().enumerate() {
            let motion = if b == 0 {
                Motion { quat: DQuat::IDENTITY, ..Motion::default() }
            } else {
                body.joints.iter().fold(body.carried(&all[body.parent]), |motion, joint| joint.moves(motion, s))
            };
            all.push(motion);
        }
        all
    }

    fn moving(&self, s: &Sample) -> Vec<Moving> {
        let bodies = self.bodies.iter().zip(self.motions(s)).skip(1);
        bodies
            .map(|(body, motion)| {
                let arm = motion.quat * body.com;
                let axes = motion.quat * body.axes;
                Moving {
                    mass: body.mass,
                    com: motion.pos + arm,
                    velocity: motion.linear + motion.angular.cross(arm),
                    angular: motion.angular,
                    spin: axes * (body.inertia * (axes.inverse() * motion.angular)),
                }
            })
            .collect()
    }

    /// Kinetic and potential energy, J.
    pub fn energy(&self, s: &Sample) -> f64 {
        let potential: f64 = self.moving(s).iter().map(|m| -m.mass * self.gravity.dot(m.com)).sum();
        self.kinetic(s) + potential
    }

    /// Kinetic energy, armature included, J.
    pub fn kinetic(&self, s: &Sample) -> f64 {
        let one = |m: &Moving| 0.5 * m.mass * m.velocity.length_squared() + 0.5 * m.angular.dot(m.spin);
        let rotors = s.qvel.iter().zip(&self.armature).map(|(v, a)| 0.5 * a * v * v);
        self.moving(s).iter().map(one).sum::<f64>() + rotors.sum::<f64>()
    }

    /// Momentum, kg m/s.
    pub fn momentum(&self, s: &Sample) -> DVec3 {
        self.moving(s).iter().map(|m| m.mass * m.velocity).sum()
    }

    /// Angular momentum about the centre of mass of everything, kg m²/s.
    pub fn angular(&self, s: &Sample) -> DVec3 {
        let bodies = self.moving(s);
        let mass: f64 = bodies.iter().map(|m| m.mass).sum();
        let com = bodies.iter().map(|m| m.mass * m.com).sum::<DVec3>() / mass;
        let velocity = bodies.iter().map(|m| m.mass * m.velocity).sum::<DVec3>() / mass;
        bodies.iter().map(|m| m.spin + m.mass * (m.com - com).cross(m.velocity - velocity)).sum()
    }

    /// The distance between two sites, m.
    pub fn distance(&self, s: &Sample, names: [&str; 2]) -> Option<f64> {
        let motions = self.motions(s);
        let place = |name: &str| {
            let (body, pos, _) = self.sites.iter().find(|(_, _, other)| other == name)?;
            Some(motions[*body].pos + motions[*body].quat * *pos)
        };
        Some(place(names[0])?.distance(place(names[1])?))
    }

    /// The height of the last body, m.
    pub fn height_of_last(&self, s: &Sample) -> f64 {
        self.motions(s).last().map_or(0.0, |motion| motion.pos.z)
    }

    /// Differences of two states' positions in tangent space, by joint: coordinates of hinges and slides, of free joints the
    /// places, and rotation vectors, rad.
    pub fn differences(&self, a: &Sample, b: &Sample) -> Differences {
        let mut out = Differences::default();
        for joint in self.bodies.iter().flat_map(|body| &body.joints) {
            let at = joint.qpos;
            let turn = match joint.kind {
                0 => {
                    out.places.extend((0..3).map(|k| a.qpos[at + k] - b.qpos[at + k]));
                    at + 3
                }
                1 => at,
                _ => {
                    out.coordinates.push(a.qpos[at] - b.qpos[at]);
                    continue;
                }
            };
            let between = quaternion(&b.qpos[turn..turn + 4]).inverse() * quaternion(&a.qpos[turn..turn + 4]);
            // Twice the arc tangent: exact for small angles, where the arc cosine is not.
            let (v, w) = (DVec3::new(between.x, between.y, between.z), between.w);
            let angle = 2.0 * v.length().atan2(w.abs());
            out.turns.extend((v.normalize_or_zero() * angle * w.signum()).to_array());
        }
        out
    }

    /// The reference configuration, at rest.
    pub fn rest(&self) -> Sample {
        Sample { time: 0.0, qpos: self.qpos0.clone(), qvel: vec![0.0; self.armature.len()] }
    }
}

/// Differences of positions.
#[derive(Clone, Debug, Default)]
pub struct Differences {
    /// Hinges and slides.
    pub coordinates: Vec<f64>,
    /// Places of free joints, m.
    pub places: Vec<f64>,
    /// Rotation vectors of free and ball joints, rad.
    pub turns: Vec<f64>,
}

impl Differences {
    /// All of them.
    pub fn all(&self) -> impl Iterator<Item = f64> + '_ {
        [&self.coordinates, &self.places, &self.turns].into_iter().flatten().copied()
    }

    /// Root mean square of all.
    pub fn rms(&self) -> f64 {
        let n = self.all().count().max(1);
        (self.all().map(|x| x * x).sum::<f64>() / n as f64).sqrt()
    }
}

impl Body {
    /// The body's frame before its joints, carried by its parent.
    fn carried(&self, parent: &Motion) -> Motion {
        let arm = parent.quat * self.pos;
        Motion {
            pos: parent.pos + arm,
            quat: parent.quat * self.quat,
            linear: parent.linear + parent.angular.cross(arm),
            angular: parent.angular,
        }
    }
}

impl Joint {
    /// The frame after the joint.
    fn moves(&self, before: Motion, s: &Sample) -> Motion {
        let q = &s.qpos[self.qpos..];
        let v = &s.qvel[self.dof..];
        match self.kind {
            0 => {
                let quat = quaternion(&q[3..7]);
                Motion {
                    pos: DVec3::from_slice(&q[..3]),
                    quat,
                    linear: DVec3::from_slice(&v[..3]),
                    angular: quat * DVec3::from_slice(&v[3..6]),
                }
            }
            1 => {
                let turn = quaternion(&q[..4]);
                self.turned(before, turn, before.quat * turn * DVec3::from_slice(&v[..3]))
            }
            2 => {
                let axis = before.quat * self.axis;
                let shift = axis * (q[0] - self.reference);
                Motion {
                    pos: before.pos + shift,
                    linear: before.linear + before.angular.cross(shift) + axis * v[0],
                    ..before
                }
            }
            _ => {
                let turn = DQuat::from_axis_angle(self.axis, q[0] - self.reference);
                self.turned(before, turn, before.quat * self.axis * v[0])
            }
        }
    }

    /// The frame turned about the joint's anchor.
    fn turned(&self, before: Motion, turn: DQuat, rate: DVec3) -> Motion {
        let arm = before.quat * self.pos;
        let quat = before.quat * turn;
        let angular = before.angular + rate;
        let back = quat * self.pos;
        Motion {
            pos: before.pos + arm - back,
            quat,
            linear: before.linear + before.angular.cross(arm) - angular.cross(back),
            angular,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const XML: &str = "<mujoco><worldbody><body pos='0 0 1'><freejoint/><geom size='.1 .2 .3' type='box'/>
        <body pos='.1 .2 .3' euler='10 20 30'><joint type='ball' pos='.1 0 .2' armature='.1'/>
        <geom type='capsule' size='.1 .2' pos='.3 0 0'/>
        <body pos='0 .3 0'><joint axis='1 2 3' pos='.2 .1 0'/><joint type='slide' axis='3 2 1'/>
        <geom type='ellipsoid' size='.1 .15 .2' pos='0 0 .2'/></body></body></body></worldbody></mujoco>";

    fn sample(nq: usize, nv: usize) -> Sample {
        let wave = |k: usize, n: usize| (0..n).map(|i| (1.3 * (i + k) as f64).sin()).collect::<Vec<_>>();
        let mut qpos = wave(1, nq);
        for at in [3, 7] {
            let quat = quaternion(&qpos[at..at + 4]);
            qpos[at..at + 4].copy_from_slice(&[quat.w, quat.x, quat.y, quat.z]);
        }
        Sample { time: 0.0, qpos, qvel: wave(5, nv) }
    }

    /// The engine's own energies come from other formulas.
    #[test]
    fn energy_is_that_of_the_engine() {
        let model = lanesim::Model::from_xml_string(XML, &Default::default()).unwrap();
        let mut worlds = lanesim::Worlds::new(&model, 1, &Default::default()).unwrap();
        let s = sample(13, 11);
        worlds.set(lanesim::Field::Qpos, 0, &s.qpos).unwrap();
        worlds.set(lanesim::Field::Qvel, 0, &s.qvel).unwrap();
        let mut energy = [0.0; 2];
        worlds.read_all(&["energy"], vec![lanesim::rows::Rows::F64(&mut energy)]).unwrap();
        let ruler = Ruler::new(&model);
        let ours = ruler.energy(&s);
        assert!((ours - energy[0] - energy[1]).abs() < 1e-10 * ours.abs(), "{ours} {energy:?}");
    }

    /// Velocities are rates of positions: the kinetic energy of a motion follows from places alone.
    #[test]
    fn momentum_is_the_rate_of_the_centre_of_mass() {
        let model = lanesim::Model::from_xml_string(XML, &Default::default()).unwrap();
        let ruler = Ruler::new(&model);
        let s = sample(13, 11);
        let h = 1e-6;
        let moved = |sign: f64| {
            let mut out = s.clone();
            (0..3).for_each(|k| out.qpos[k] += sign * h * s.qvel[k]);
            for (at, dof) in [(3, 3), (7, 6)] {
                let turn = DQuat::from_scaled_axis(DVec3::from_slice(&s.qvel[dof..]) * sign * h);
                let quat = quaternion(&s.qpos[at..at + 4]) * turn;
                out.qpos[at..at + 4].copy_from_slice(&[quat.w, quat.x, quat.y, quat.z]);
            }
            out.qpos[11] += sign * h * s.qvel[9];
            out.qpos[12] += sign * h * s.qvel[10];
            ruler.moving(&out).iter().map(|m| m.mass * m.com).sum::<DVec3>()
        };
        let rate = (moved(1.0) - moved(-1.0)) / (2.0 * h);
        assert!(rate.distance(ruler.momentum(&s)) < 1e-6 * rate.length(), "{rate} {}", ruler.momentum(&s));
    }

    #[test]
    fn turns_are_small_angles_exactly() {
        let model = lanesim::Model::from_xml_string(XML, &Default::default()).unwrap();
        let ruler = Ruler::new(&model);
        let s = sample(13, 11);
        let mut t = s.clone();
        let turn = DQuat::from_scaled_axis(DVec3::new(1e-9, 0.0, 0.0));
        let quat = quaternion(&s.qpos[3..7]) * turn;
        t.qpos[3..7].copy_from_slice(&[quat.w, quat.x, quat.y, quat.z]);
        let turns = ruler.differences(&t, &s).turns;
        assert!((turns[0] - 1e-9).abs() < 1e-15 && turns[1].abs() < 1e-15, "{turns:?}");
    }
}
