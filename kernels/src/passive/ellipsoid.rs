//! Forces of a medium on geoms, each taken for an ellipsoid (MuJoCo's documentation, Computation, Fluid forces: the ellipsoid model): the
//! inertia of what is carried along, drag that depends on how blunt the shape is in the direction of motion, the lift of Kutta and of
//! Magnus, and the viscous resistance of a sphere of about its size.

use std::f64::consts::PI;
use std::ops::{Add, Mul, Neg, Range, Sub};

use super::fluid::Immersed;
use crate::lane::Lane;
use crate::math::tree;
use crate::math::vec3::{Vec3, build};
use crate::model::{Ellipsoid, Instance, Model, NONE};
use crate::position::Position;
use crate::velocity::Velocity;

/// Numbers below this are not divided by. What is divided by has no unit or is a speed; the square of its inverse is still a number in
/// single precision.
const LEAST: f64 = 1e-18;
/// The reference's bound for what is carried along.
const MINVAL: f64 = 1e-15;

/// What the law computes with: numbers, or numbers with their derivatives.
trait Number<L: Lane>:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Mul<L, Output = Self> + Neg<Output = Self>
{
    /// Root of a number that is not negative.
    fn root(self) -> Self;
    /// One over the number, or over [`LEAST`] if that is more.
    fn inverse(self) -> Self;
    /// The number and a constant.
    fn plus(self, constant: L) -> Self;
}

/// A number alone.
#[derive(Clone, Copy)]
struct Plain<L>(L);

/// A number, and what it gains with each of six others.
#[derive(Clone, Copy)]
struct Slope<L>(L, [L; 6]);

macro_rules! operators {
    ($($operator:ident $f:ident $own:ident;)*) => { $(
        impl<L: Lane> $operator for Plain<L> {
            type Output = Self;
            #[inline(always)]
            fn $f(self, other: Self) -> Self {
                Plain(self.0.$f(other.0))
            }
        }
        impl<L: Lane> $operator for Slope<L> {
            type Output = Self;
            #[inline(always)]
            fn $f(self, other: Self) -> Self {
                Slope(self.0.$f(other.0), build(|k| self.$own(&other, k)))
            }
        }
    )* };
}

operators! {
    Add add sum;
    Sub sub difference;
    Mul mul product;
}

impl<L: Lane> Slope<L> {
    #[inline(always)]
    fn sum(&self, other: &Self, k: usize) -> L {
        self.1[k] + other.1[k]
    }
    #[inline(always)]
    fn difference(&self, other: &Self, k: usize) -> L {
        self.1[k] - other.1[k]
    }
    #[inline(always)]
    fn product(&self, other: &Self, k: usize) -> L {
        self.1[k].mul_add(other.0, self.0 * other.1[k])
    }
    /// The same with a derivative that is multiplied.
    #[inline(always)]
    fn chain(&self, value: L, factor: L) -> Self {
        Slope(value, build(|k| factor * self.1[k]))
    }
}

impl<L: Lane> Mul<L> for Plain<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        Plain(self.0 * factor)
    }
}

impl<L: Lane> Mul<L> for Slope<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        self.chain(self.0 * factor, factor)
    }
}

impl<L: Lane> Neg for Plain<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Plain(-self.0)
    }
}

impl<L: Lane> Neg for Slope<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.0, -L::one())
    }
}

impl<L: Lane> Number<L> for Plain<L> {
    #[inline(always)]
    fn plus(self, constant: L) -> Self {
        Plain(self.0 + constant)
    }
    #[inline(always)]
    fn root(self) -> Self {
        Plain(self.0.sqrt())
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        Plain(L::one() / self.0.max(L::of(LEAST)))
    }
}

impl<L: Lane> Number<L> for Slope<L> {
    #[inline(always)]
    fn plus(self, constant: L) -> Self {
        Slope(self.0 + constant, self.1)
    }
    #[inline(always)]
    fn root(self) -> Self {
        let root = self.0.sqrt();
        let some = root.gt(L::zero());
        self.chain(root, L::select(some, L::of(0.5) / L::select(some, root, L::one()), L::zero()))
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        let (least, inverse) = (L::of(LEAST), L::one() / self.0.max(L::of(LEAST)));
        self.chain(inverse, L::select(self.0.lt(least), L::zero(), -inverse * inverse))
    }
}

#[inline(always)]
fn dot<L: Lane, N: Number<L>>(a: &[N; 3], b: &[N; 3]) -> N {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<L: Lane, N: Number<L>>(a: &[N; 3], b: &[N; 3]) -> [N; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Torque and force on an ellipsoid that turns at `w` and moves at `v`, all along its axes.
#[inline(always)]
fn law<L: Lane, N: Number<L>>(body: &Ellipsoid<L::Real>, w: &[N; 3], v: &[N; 3]) -> [[N; 3]; 2] {
    let along = |scale: &[L::Real; 3], x: &[N; 3]| [0, 1, 2].map(|k: usize| x[k] * L::splat(scale[k]));
    let [carried, spun, stirred] = [along(&body.carried, v), along(&body.spun, w), along(&body.stirred, w)];
    // Direction of the stream; normal of the surface where it meets the stream, times how broad it is across; the root of the quotient
    // below is in proportion to the area of the shadow. Neither has a unit, so that no shape is too thin and no stream too slow.
    let speed = dot(v, v).root();
    let slow = speed.inverse();
    let stream = [0, 1, 2].map(|k: usize| v[k] * slow);
    let normal = along(&body.areas, &stream);
    let (num, den) = (dot(&normal, &stream), dot(&normal, &normal));
    let shadow = (den * num.inverse()).root();
    let lift = num * den.inverse() * shadow * speed * speed * L::splat(body.kutta);
    let kutta = cross(&cross(&normal, &stream), &stream);
    let (magnus, drift) = (cross(w, v), cross(&carried, w));
    let drag = (speed * (shadow * L::splat(body.blunt)).plus(L::splat(body.slender))).plus(L::splat(body.linear[1]));
    let spin = dot(&stirred, &stirred).root().plus(L::splat(body.linear[0]));
    let (turned, pushed) = (cross(&carried, v), cross(&spun, w));
    let torque = [0, 1, 2].map(|k: usize| turned[k] + pushed[k] - w[k] * spin);
    let force = [0, 1, 2].map(|k: usize| drift[k] + magnus[k] * L::splat(body.magnus) + kutta[k] * lift - v[k] * drag);
    [torque, force]
}

/// Adds the forces of the medium.
pub(super) fn add<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    velocity: &Velocity<L>,
    qfrc_passive: &mut [L],
) {
    let wind = build(|k| L::of(model.options.wind[k]));
    for body in &model.ellipsoids {
        let placed = Immersed::new(body.link, &body.pos, &body.rot, position);
        let [w, v] = placed.along(&velocity.cvel[body.link as usize], &wind).map(|part| part.map(Plain));
        let felt = law(body, &w, &v).map(|part| part.map(|x: Plain<L>| x.0));
        tree::push(&model, &position.cdof, body.link as usize, &placed.wrench(&felt), qfrc_passive);
    }
}

/// What torque and force gain with angular velocity and velocity, all along the axes: row by row.
#[inline(always)]
fn slopes<L: Lane>(body: &Ellipsoid<L::Real>, [w, v]: &[Vec3<L>; 2]) -> [[L; 6]; 6] {
    let unit = |x: L, k: usize| {
        let mut slope = [L::zero(); 6];
        slope[k] = L::one();
        Slope(x, slope)
    };
    let [w, v] = [[0, 1, 2].map(|k: usize| unit(w[k], k)), [0, 1, 2].map(|k: usize| unit(v[k], 3 + k))];
    let [[a, b, c], [d, e, f]] = law(body, &w, &v);
    [a.1, b.1, c.1, d.1, e.1, f.1]
}

/// Takes h times what the forces on a tree's links gain with velocity from a matrix: the symmetric part of it, from the rows, or all,
/// from rows and columns.
pub(crate) fn add_slope<L: Lane>(
    model: &Model<L::Real>,
    (position, velocity): (&Position<L>, &Velocity<L>),
    (links, skew): (Range<usize>, bool),
    h: L,
    (lower, upper): (&mut [L], &mut [L]),
) {
    let (still, wind) = ([L::zero(); 3], build(|k| L::of(model.options.wind[k])));
    for body in model.ellipsoids.iter().filter(|body| links.contains(&(body.link as usize))) {
        let placed = Immersed::new(body.link, &body.pos, &body.rot, position);
        let gain = slopes(body, &placed.along(&velocity.cvel[body.link as usize], &wind));
        // What is felt of a motion, by the matrix or by its transpose.
        let felt = |motion: &[L; 6], gain: &dyn Fn(usize, usize) -> L| {
            let part = |k: usize| (0..6).fold(L::zero(), |sum, j| gain(k, j).neg_mul_add(motion[j], sum));
            placed.wrench(&[[part(0), part(1), part(2)], [part(3), part(4), part(5)]])
        };
        let half = L::of(0.5);
        let mut i = model.links[body.link as usize].dofs.range().end as u32 - 1;
        while i != NONE {
            let [[a, b, c], [d, e, f]] = placed.along(&position.cdof[i as usize], &still);
            let motion = [a, b, c, d, e, f].map(|x| h * x);
            let column = felt(&motion, &|k, j| if skew { gain[k][j] } else { half * (gain[k][j] + gain[j][k]) });
            let row = skew.then(|| felt(&motion, &|k, j| gain[j][k]));
            let mut j = i;
            while j != NONE {
                let at = model.rows.at(i as usize, j as usize);
                let project = |wrench| tree::project(model, &position.cdof, j as usize, wrench);
                // An entry of a row is what dof i feels of the motion of dof j.
                lower[at] += project(row.as_ref().unwrap_or(&column));
                if skew && j != i {
                    upper[at] += project(&column);
                }
                j = model.dofs[j as usize].parent;
            }
            i = model.dofs[i as usize].parent;
        }
    }
}

/// Nodes of Kronrod's rule for 15 points on [-1, 1], and their weights: those that are not negative. MuJoCo has them on [0, 1], to eight
/// digits, which shows in what they give.
const NODES: [[f64; 2]; 8] = [
    [0.991_455_371_120_812_6, 0.022_935_322_010_529_22],
    [0.949_107_912_342_758_5, 0.063_092_092_629_978_55],
    [0.864_864_423_359_769_1, 0.104_790_010_322_250_18],
    [0.741_531_185_599_394_4, 0.140_653_259_715_525_92],
    [0.586_087_235_467_691_1, 0.169_004_726_639_267_9],
    [0.405_845_151_377_397_2, 0.190_350_578_064_785_4],
    [0.207_784_955_007_898_47, 0.204_432_940_075_298_9],
    [0.0, 0.209_482_141_084_727_82],
];

/// Of what is carried along: ∫ xyz / √((x² + λ)³ (y² + λ) (z² + λ)) dλ over all λ that are positive, times x² / xyz, the first axis first.
/// With λ = s t³ / (1 - t)², t goes from 0 to 1.
fn carried_share([x, y, z]: [f64; 3]) -> f64 {
    let digits = |x: f64| (x * 1e8).round() / 1e8;
    let scale = (x * x * x * y * z).powf(0.4);
    let term = |t: f64, weight: f64| {
        let lambda = scale * t.powi(3) / (1.0 - t).powi(2);
        let stretch = t * t * (3.0 - t) / (1.0 - t).powi(3);
        let [a, b, c] = [x, y, z].map(|axis| 1.0 + lambda / (axis * axis));
        scale * stretch * weight / (a.powi(3) * b * c).sqrt()
    };
    let sum: f64 = NODES
        .iter()
        .map(|[node, weight]| {
            let weight = digits(0.5 * weight);
            let low = term(digits(0.5 * (1.0 - node)), weight);
            if *node > 0.0 { low + term(digits(0.5 * (1.0 + node)), weight) } else { low }
        })
        .sum();
    sum / (x * x)
}

/// Volume, or moment about each axis, of the medium that an ellipsoid of these semiaxes carries along.
fn carried_along(axes: [f64; 3]) -> [[f64; 3]; 2] {
    let volume = 4.0 / 3.0 * PI * axes.iter().product::<f64>();
    let turned = |k: usize| [axes[k], axes[(k + 1) % 3], axes[(k + 2) % 3]];
    let share = [0, 1, 2].map(|k| carried_share(turned(k)));
    let moment = |k: usize| {
        let [_, y, z] = turned(k).map(|x| x * x);
        let apart = share[(k + 2) % 3] - share[(k + 1) % 3];
        let denominator = 2.0 * (y - z) - (y + z) * apart;
        volume / 5.0 * (y - z).powi(2) * apart / denominator.abs().max(MINVAL).copysign(denominator)
    };
    [[0, 1, 2].map(|k| volume * share[k] / (2.0 - share[k]).max(MINVAL)), [0, 1, 2].map(moment)]
}

impl Ellipsoid<f64> {
    /// Its numbers, of one with the given semiaxes and coefficients (drag of blunt, slender and turning shapes, lift of Kutta and of Magnus)
    /// in a medium of some density and viscosity; at the origin of a link.
    pub fn new(link: u32, axes: [f64; 3], coefficients: [f64; 5], density: f64, viscosity: f64) -> Ellipsoid<f64> {
        let [blunt, slender, turning, kutta, magnus] = coefficients;
        let others = |k: usize| [axes[(k + 1) % 3], axes[(k + 2) % 3]];
        let mut sorted = axes;
        sorted.sort_by(f64::total_cmp);
        let [_, middle, longest] = sorted;
        let broad = middle * longest;
        let sum: f64 = axes.iter().sum();
        let (volume, size) = (4.0 / 3.0 * PI * axes.iter().product::<f64>(), 2.0 / 3.0 * sum);
        let largest = 8.0 / 15.0 * PI * middle * longest.powi(4);
        let [carried, spun] = carried_along(axes);
        let stirred = |k: usize| {
            let [one, other] = others(k);
            let moment = 8.0 / 15.0 * PI * axes[k] * one.max(other).powi(4);
            density * (turning * moment + slender * (largest - moment))
        };
        Ellipsoid {
            link,
            pos: [0.0; 3],
            rot: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            areas: [0, 1, 2].map(|k| (others(k).iter().product::<f64>() / broad).powi(2)),
            carried: carried.map(|x| density * x),
            spun: spun.map(|x| density * x),
            stirred: [0, 1, 2].map(stirred),
            linear: [PI * size.powi(3) * viscosity, 3.0 * PI * size * viscosity],
            blunt: density * PI * (blunt - slender) * broad,
            slender: density * slender * PI * broad,
            kutta: density * PI * kutta * broad,
            magnus: density * magnus * volume,
        }
    }
}
