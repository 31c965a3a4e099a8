//! How random models are made.

use lanesim::Model;
use lanesim::spec::{Body, Geom, GeomMass, Inertia, Inertial, Joint, JointKind, Shape, Spec};
use lanesim_kernels::model::JointKind as Kind;
use lanesim_kernels::options::{Cone, Solver};
use proptest::prelude::{Strategy, any, prop};

/// A joint: its kind, and numbers in [-1, 1] for anchor, axis and the rest.
#[derive(Clone, Debug)]
pub struct JointRecipe {
    kind: u8,
    anchor: [f64; 3],
    axis: [f64; 3],
    armature: f64,
}

/// A body: where it hangs, how it moves, what it weighs.
#[derive(Clone, Debug)]
pub struct BodyRecipe {
    parent: usize,
    joints: Vec<JointRecipe>,
    pos: [f64; 3],
    quat: [f64; 4],
    com: [f64; 3],
    mass: f64,
    extent: [f64; 3],
}

/// A tree of bodies, and what seeds its states.
#[derive(Clone, Debug)]
pub struct TreeRecipe {
    bodies: Vec<BodyRecipe>,
    /// Seed of the states.
    pub seed: u64,
}

fn number() -> impl Strategy<Value = f64> {
    -1.0..1.0
}

fn triple() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(number())
}

fn joint() -> impl Strategy<Value = JointRecipe> {
    (0_u8..4, triple(), triple(), 0.0..0.1).prop_map(|(kind, anchor, axis, armature)| JointRecipe {
        kind,
        anchor,
        axis,
        armature,
    })
}

fn body() -> impl Strategy<Value = BodyRecipe> {
    let shape = (0.2..3.0, prop::array::uniform3(0.05..0.3));
    let joints = prop::collection::vec(joint(), 0..=3);
    (any::<usize>(), joints, triple(), prop::array::uniform4(number()), triple(), shape).prop_map(
        |(parent, joints, pos, quat, com, (mass, extent))| BodyRecipe { parent, joints, pos, quat, com, mass, extent },
    )
}

/// Trees of one to nine bodies: hinges, slides, balls and free roots, up to three joints each, branches, bodies without
/// joints.
pub fn tree() -> impl Strategy<Value = TreeRecipe> {
    (prop::collection::vec(body(), 1..10), any::<u64>()).prop_map(|(bodies, seed)| TreeRecipe { bodies, seed })
}

impl TreeRecipe {
    /// The model: without damping and springs, so that energy is kept.
    pub fn model(&self) -> Model {
        let mut spec = Spec::new("tree");
        spec.option.flags.energy = true;
        for (i, recipe) in self.bodies.iter().enumerate() {
            let parent = recipe.parent % (i + 1);
            spec.add_body(parent, recipe.body(parent == 0));
        }
        Model::from_spec(&spec).unwrap_or_else(|e| panic!("{e}"))
    }
}

impl BodyRecipe {
    fn body(&self, root: bool) -> Body {
        let [a, b, c] = self.extent.map(|x| x * x);
        let inertial = Inertial {
            pos: self.com.map(|x| 0.2 * x),
            quat: unit(self.quat),
            mass: self.mass,
            inertia: Inertia::Diagonal([b + c, a + c, a + b].map(|x| self.mass / 3.0 * x)),
            source: lanesim::spec::Source::default(),
        };
        let free = root && self.joints.first().is_some_and(|joint| joint.kind == 3);
        let joints: Vec<Joint> = if free {
            vec![Joint { kind: JointKind::Free, ..Joint::default() }]
        } else {
            // A ball turns any way, and is followed by slides only.
            let ball = self.joints.iter().position(|joint| joint.kind == 2).unwrap_or(usize::MAX);
            let allowed = self.joints.iter().enumerate().filter(|(i, joint)| *i <= ball || joint.kind == 1);
            allowed.map(|(_, joint)| joint.joint()).collect()
        };
        let pos = self.pos.map(|x| if root { 2.0 * x } else { 0.5 * x });
        Body { pos, quat: unit(self.quat), inertial: Some(inertial), joints, ..Body::default() }
    }
}

impl JointRecipe {
    fn joint(&self) -> Joint {
        let kind = [JointKind::Hinge, JointKind::Slide, JointKind::Ball, JointKind::Hinge][self.kind as usize];
        let long = self.axis.iter().any(|x| x.abs() > 0.1);
        // Coordinate axes have code of their own.
        let axis = if long && self.kind != 3 { self.axis } else { [0.0, 1.0, 0.0] };
        Joint { kind, pos: self.anchor.map(|x| 0.2 * x), axis, armature: self.armature + 0.01, ..Joint::default() }
    }
}

/// A body in a heap: shape, place, how it hangs on the one below.
#[derive(Clone, Debug)]
struct Piece {
    shape: u8,
    sizes: [f64; 3],
    pos: [f64; 3],
    quat: [f64; 4],
    hinged: bool,
    friction: [f64; 3],
    condim: usize,
}

/// A heap of bodies on a floor that touch each other, and what seeds its states.
#[derive(Clone, Debug)]
pub struct HeapRecipe {
    pieces: Vec<Piece>,
    elliptic: bool,
    impratio: f64,
    dry: bool,
    /// Seed of the states.
    pub seed: u64,
}

fn piece() -> impl Strategy<Value = Piece> {
    let body = (0_u8..6, prop::array::uniform3(0.06..0.15), triple(), prop::array::uniform4(number()), any::<bool>());
    let contact = (0.1..1.2, 0.001..0.1, 0.001..0.05, 0_usize..4);
    (body, contact).prop_map(|((shape, sizes, pos, quat, hinged), (slide, spin, roll, condim))| Piece {
        shape,
        sizes,
        pos,
        quat,
        hinged,
        friction: [slide, spin, roll],
        condim,
    })
}

/// Heaps of one to five bodies of any shape, some of them hanging on the one before; any cone and dimension.
pub fn heap() -> impl Strategy<Value = HeapRecipe> {
    let pieces = prop::collection::vec(piece(), 1..=5);
    (pieces, any::<bool>(), 0.5..5.0, any::<bool>(), any::<u64>())
        .prop_map(|(pieces, elliptic, impratio, dry, seed)| HeapRecipe { pieces, elliptic, impratio, dry, seed })
}

impl HeapRecipe {
    /// The model, its solver set to go as far as it can.
    pub fn model(&self, solver: Solver) -> Model {
        let mut spec = self.spec(solver);
        let option = &mut spec.option;
        (option.tolerance, option.ls_tolerance, option.iterations) = match solver {
            Solver::Newton => (1e-14, 1e-6, 300),
            Solver::Cg => (1e-14, 1e-6, 20_000),
            Solver::Pgs => (1e-24, 1e-6, 100_000),
        };
        Model::from_spec(&spec).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The model with MuJoCo's settings of the solver.
    pub fn model_as_usual(&self, solver: Solver) -> Model {
        Model::from_spec(&self.spec(solver)).unwrap_or_else(|e| panic!("{e}"))
    }

    fn spec(&self, solver: Solver) -> Spec {
        let mut spec = Spec::new("heap");
        let option = &mut spec.option;
        option.cone = if self.elliptic { Cone::Elliptic } else { Cone::Pyramidal };
        option.impratio = self.impratio;
        option.solver = solver;
        spec.bodies[0].geoms.push(Geom {
            shape: Shape::Plane,
            size: [5.0, 5.0, 0.1],
            conaffinity: 7,
            ..Geom::default()
        });
        let mut below = 0;
        for (i, piece) in self.pieces.iter().enumerate() {
            let hinged = piece.hinged && below > 0;
            let parent = if hinged { below } else { 0 };
            below = spec.add_body(parent, piece.body(i, hinged, self.dry));
        }
        spec
    }
}

impl Piece {
    fn body(&self, place: usize, hinged: bool, dry: bool) -> Body {
        let (shape, size) = match self.shape {
            0 => (Shape::Sphere, [self.sizes[0], 0.0, 0.0]),
            1 => (Shape::Capsule, [self.sizes[0], self.sizes[1], 0.0]),
            2 => (Shape::Ellipsoid, self.sizes),
            3 => (Shape::Cylinder, [self.sizes[0], self.sizes[1], 0.0]),
            _ => (Shape::Box, self.sizes),
        };
        let geom = Geom {
            shape,
            size,
            friction: self.friction,
            condim: [1, 3, 4, 6][self.condim],
            mass: GeomMass::Density(600.0),
            ..Geom::default()
        };
        let frictionloss = if dry { 0.05 } else { 0.0 };
        let joint = if hinged {
            Joint { axis: [1.0, 0.5, 0.2], armature: 0.01, frictionloss, range: Some([-0.2, 0.3]), ..Joint::default() }
        } else {
            Joint { kind: JointKind::Free, ..Joint::default() }
        };
        let pos = if hinged {
            self.pos.map(|x| 0.2 * x)
        } else {
            [0.1 * self.pos[0], 0.1 * self.pos[1], 0.11 + 0.17 * place as f64]
        };
        Body { pos, quat: unit(self.quat), joints: vec![joint], geoms: vec![geom], ..Body::default() }
    }
}

/// A unit quaternion.
fn unit(q: [f64; 4]) -> [f64; 4] {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length < 0.1 { [1.0, 0.0, 0.0, 0.0] } else { q.map(|x| x / length) }
}

/// Positions after moving along `velocity` for a time `h`.
pub fn integrate(model: &Model, qpos: &[f64], velocity: &[f64], h: f64) -> Vec<f64> {
    let mut out = qpos.to_vec();
    for joint in &model.tables().joints {
        let (q, v) = (joint.qpos as usize, joint.dof as usize);
        let (turn, rate) = match joint.kind {
            Kind::Free => {
                (0..3).for_each(|k| out[q + k] += h * velocity[v + k]);
                (q + 3, v + 3)
            }
            Kind::Ball => (q, v),
            Kind::Slide | Kind::Hinge => {
                out[q] += h * velocity[v];
                continue;
            }
        };
        let w = [0, 1, 2].map(|k| h * velocity[rate + k]);
        let angle = w.iter().map(|x| x * x).sum::<f64>().sqrt();
        let s = if angle > 0.0 { (angle / 2.0).sin() / angle } else { 0.5 };
        let step = [(angle / 2.0).cos(), s * w[0], s * w[1], s * w[2]];
        let now: [f64; 4] = std::array::from_fn(|k| out[turn + k]);
        out[turn..turn + 4].copy_from_slice(&unit(product(&now, &step)));
    }
    out
}

/// Quaternion product.
pub fn product(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}
