//! Rows of contacts.

use std::collections::HashMap;
use std::hash::Hash;

use super::{Cone, Constraint, ContactRow, Kind, Strength, dof_rows};
use crate::collision::{Contact, reference};
use crate::lane::Lane;
use crate::math::spatial::{Spatial, dot6};
use crate::math::vec3::{Vec3, cross, neg, row};
use crate::model::{Impedance, Instance, Model, NONE, Pair, PairDof, Sides};
use crate::options;
use crate::position::Position;
use crate::tendon::Tendons;
use crate::velocity::Velocity;

/// Where a block's links and tendons are, and how they move.
#[derive(Debug)]
pub struct Motion<'a, L> {
    /// Poses, and axes of dofs.
    pub position: &'a Position<L>,
    /// Motions of links.
    pub velocity: &'a Velocity<L>,
    /// Tendons.
    pub tendons: &'a Tendons<L>,
    /// Velocities of dofs.
    pub qvel: &'a [L],
}

impl<L> Clone for Motion<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for Motion<'_, L> {}

/// What the contacts of a pair have in common.
fn row_of<T>(model: &Model<T>, kinds: &[Kind], number: u32, pair: &Pair<T>) -> ContactRow {
    let kind = kind(model, pair);
    ContactRow {
        contact: 0,
        pair: number,
        dim: kind.dim,
        component: 0,
        lanes: 0,
        sides: kind.sides,
        link: reference(pair),
        other: if pair.sides == Sides::Two { pair.link1 } else { NONE },
        jacobian: 0,
        strength: 0,
        cone: kind.cone,
        number: kinds.iter().position(|known| *known == kind).unwrap_or(kinds.len()) as u32,
        place: 0,
        law: NONE,
        links: NONE,
        couple: NONE,
    }
}

/// Contacts that one piece of code does for, each class with a row of its first pair.
#[derive(Clone, Debug, Default)]
pub struct Classes {
    /// Numbers of rows where one side stands still: by cone, dimension, which side, and impedance.
    pub laws: Vec<ContactRow>,
    /// The same where both sides move: by dofs, dimension and impedance.
    pub links: Vec<ContactRow>,
    /// What they add to the Hessian: by links and dimension.
    pub couples: Vec<ContactRow>,
    /// All else: [kinds] of those with sides in one tree; of others by dofs, relative to the first of each tree, and cone.
    pub kinds: Vec<ContactRow>,
}

/// Numbers classes in the order in which they are met.
struct Numbering<K> {
    numbers: HashMap<K, u32>,
    /// The first pair of each.
    pairs: Vec<u32>,
}

impl<K: Hash + Eq> Numbering<K> {
    fn new() -> Self {
        Numbering { numbers: HashMap::new(), pairs: vec![] }
    }

    /// The number of the class of a pair.
    fn of(&mut self, key: K, pair: u32) -> u32 {
        let Numbering { numbers, pairs } = self;
        *numbers.entry(key).or_insert_with(|| {
            pairs.push(pair);
            pairs.len() as u32 - 1
        })
    }
}

/// By pair, what its contacts have in common, and the classes of these.
pub fn rows_of_pairs<T>(model: &Model<T>) -> (Vec<ContactRow>, Classes) {
    let kinds = kinds(model);
    let (mut laws, mut links) = (Numbering::new(), Numbering::new());
    let (mut couples, mut apart) = (Numbering::new(), Numbering::new());
    let mut of_kinds = vec![None; kinds.len()];
    let row = |(number, pair): (u32, &Pair<T>)| {
        let mut row = row_of(model, &kinds, number, pair);
        if pair.rigid() {
            return row;
        }
        let impedance = (pair.impedance.flat, pair.impedance.small_power);
        if pair.sides == Sides::One {
            row.law = laws.of((row.cone, row.dim, pair.link2 == NONE, impedance), number);
        } else {
            let dofs = &model.pair_dofs[pair.dofs.range()];
            let apart_from = |side: bool| if pair.sides == Sides::Apart { first_dof(model, pair, side) } else { 0 };
            let firsts = [false, true].map(apart_from);
            let of = |entry: &PairDof| (entry.second, entry.dof - firsts[usize::from(entry.second)]);
            let dofs: Vec<(bool, u32)> = dofs.iter().map(of).collect();
            row.links = links.of((pair.sides, dofs.clone(), row.dim, impedance), number);
            row.couple = couples.of((pair.link1, pair.link2, row.dim), number);
            if pair.sides == Sides::Apart {
                row.number = kinds.len() as u32 + apart.of((dofs, row.dim), number);
            }
        }
        if let Some(place) = of_kinds.get_mut(row.number as usize) {
            place.get_or_insert(number);
        }
        row
    };
    let rows: Vec<ContactRow> = (0..).zip(&model.pairs).map(row).collect();
    let of = |pairs: Vec<u32>| pairs.into_iter().map(|pair| rows[pair as usize]).collect();
    let kinds = of_kinds.into_iter().flatten().chain(apart.pairs).collect();
    let classes =
        Classes { laws: of(laws.pairs), links: of(links.pairs), couples: of(couples.pairs), kinds: of(kinds) };
    (rows, classes)
}

/// The first of the dofs of a pair that move its first link and not the second, or the other way round; 0 if there are none.
pub fn first_dof<T>(model: &Model<T>, pair: &Pair<T>, second: bool) -> u32 {
    let mut dofs = model.pair_dofs[pair.dofs.range()].iter().filter(|entry| entry.second == second);
    dofs.next().map_or(0, |entry| entry.dof)
}

/// Makes a list as long as that if it is shorter.
#[inline(always)]
pub(crate) fn grow<X: Copy>(list: &mut Vec<X>, len: usize, filling: X) {
    if list.len() < len {
        list.resize(len, filling);
    }
}

/// What a contact's rows depend on beside motion: as [`Pair`].
#[derive(Clone, Debug)]
struct Grip<L> {
    cone: Cone,
    /// Of frictional to normal impedance.
    impratio: f64,
    /// Whether it is the first geom that moves, and not the second.
    flipped: bool,
    margin: L,
    invweight: L,
    friction_b: L,
    friction: [L; 5],
    impedance: Impedance<L>,
}

impl<L: Lane> Grip<L> {
    /// That of a pair.
    #[inline(always)]
    pub fn new(model: Instance<'_, L>, pair: usize) -> Self {
        Self::of(&model, &model.pairs[pair], model.law(pair))
    }

    /// That of a pair like this one, with other [numbers](Pair::law).
    #[inline(always)]
    pub fn of(model: &Model<L::Real>, pair: &Pair<L::Real>, numbers: [L; Pair::<f64>::LAW]) -> Self {
        let [margin, invweight, friction_b, f1, f2, f3, f4, f5, impedance @ ..] = numbers;
        Grip {
            cone: cone(model, pair),
            impratio: model.options.impratio,
            flipped: pair.link2 == NONE,
            margin,
            invweight,
            friction_b,
            friction: [f1, f2, f3, f4, f5],
            impedance: pair.impedance.with(impedance),
        }
    }
}

/// What is kept of a contact.
#[derive(Debug)]
pub struct Numbers<'a, L> {
    /// What decides its force.
    pub strength: &'a mut Strength<L>,
    /// By component, the motion row.
    pub motion: &'a mut [Spatial<L>],
    /// By component, minus the reference acceleration.
    pub reference: &'a mut [L],
}

/// Writes a contact's numbers.
#[inline(always)]
pub fn measure<L: Lane>(
    model: Instance<'_, L>,
    motion: Motion<'_, L>,
    contact: Contact<'_, L>,
    row: &ContactRow,
    constraint: &mut Constraint<L>,
) {
    let Motion { position, velocity, qvel, .. } = motion;
    let pair = &model.pairs[row.pair as usize];
    let (grip, dofs) = (Grip::new(model, row.pair as usize), &model.pair_dofs[pair.dofs.range()]);
    let (out, jacobian) = constraint.numbers_mut(row, dofs.len());
    if row.sides == Sides::One {
        return still_side(&grip, contact, &velocity.cvel[row.link as usize], out);
    }
    let at = match row.sides {
        Sides::Two => contact.pos(),
        _ => position.moved(&model, &contact.pos(), pair.link2, pair.link1),
    };
    both_sides(&grip, contact, &at, dofs, (&position.cdof, qvel), jacobian, out);
}

/// What decides a contact's force, where its components have given speeds.
#[derive(Clone, Copy, Debug)]
pub struct Regular<L> {
    /// The numbers of its law.
    pub strength: Strength<L>,
    /// By component, minus the reference acceleration.
    pub reference: [L; 6],
    /// By component, what that gains with the component's speed.
    pub damping: [L; 6],
}

/// That of a contact of the pair with this number.
#[inline(always)]
pub fn regular<L: Lane>(model: Instance<'_, L>, number: usize, contact: Contact<'_, L>, speeds: &[L; 6]) -> Regular<L> {
    let (dim, grip) = (model.pairs[number].condim as usize, Grip::new(model, number));
    let (mut strength, mut reference) = ([L::zero(); 7], [L::zero(); 6]);
    let out = Numbers { strength: &mut strength, motion: &mut [], reference: &mut reference[..dim] };
    regularise(&grip, contact, speeds, out);
    let side = if grip.cone == Cone::Ellipse { grip.friction_b } else { grip.impedance.b };
    let damping = std::array::from_fn(|i| if i == 0 { grip.impedance.b } else { side });
    Regular { strength, reference, damping }
}

/// The components' motion rows at a point `at` relative to a tree's origin: (at × n; n) for a translation along `n`,
/// (n; 0) for a rotation about it.
#[inline(always)]
pub fn motion_row<L: Lane>(contact: Contact<'_, L>, at: &Vec3<L>, component: usize) -> Spatial<L> {
    let z = L::zero();
    let n = row(contact.frame(), component % 3);
    if component < 3 {
        let torque = cross(at, &n);
        [torque[0], torque[1], torque[2], n[0], n[1], n[2]]
    } else {
        [n[0], n[1], n[2], z, z, z]
    }
}

/// Numbers of a contact one side of which stands still, the other has the motion `twist`.
#[inline(always)]
fn still_side<L: Lane>(grip: &Grip<L>, contact: Contact<'_, L>, twist: &Spatial<L>, out: Numbers<'_, L>) {
    let mut speeds = [L::zero(); 6];
    for (i, (speed, motion)) in speeds.iter_mut().zip(&mut *out.motion).enumerate() {
        let w = motion_row(contact, &contact.pos(), i);
        // The relative motion is that of the second body; it is minus the first's where the second stands still.
        let w = if grip.flipped { neg(&w) } else { w };
        *speed = dot6(&w, twist);
        *motion = w;
    }
    regularise(grip, contact, &speeds, out);
}

/// Numbers and Jacobian of a contact between two links; its place is `at` from the origin of the first's tree. `dofs` are
/// those of the pair, with the axes and velocities of all.
#[inline(always)]
fn both_sides<L: Lane>(
    grip: &Grip<L>,
    contact: Contact<'_, L>,
    at: &Vec3<L>,
    dofs: &[PairDof],
    (axes, qvel): (&[Spatial<L>], &[L]),
    jacobian: &mut [L],
    out: Numbers<'_, L>,
) {
    let mut first = [[L::zero(); 6]; 6];
    // Between trees nobody reads `motion`, but the component's index is the same there and in `reference`.
    for (i, (first, second)) in first.iter_mut().zip(&mut *out.motion).enumerate() {
        *second = motion_row(contact, &contact.pos(), i);
        *first = neg(&motion_row(contact, at, i));
    }
    let mut speeds = [L::zero(); 6];
    for (entry, column) in dofs.iter().zip(jacobian.chunks_exact_mut(out.motion.len())) {
        let dof = entry.dof as usize;
        let rows = if entry.second { &*out.motion } else { &first[..] };
        for ((j, speed), w) in column.iter_mut().zip(&mut speeds).zip(rows) {
            *j = dot6(w, &axes[dof]);
            *speed = j.mul_add(qvel[dof], *speed);
        }
    }
    regularise(grip, contact, &speeds, out);
}

/// The kind of a pair's contacts.
fn kind<T>(model: &Model<T>, pair: &Pair<T>) -> Kind {
    Kind { sides: pair.sides, cone: cone(model, pair), dim: pair.condim }
}

/// The kinds of the contacts with sides in one tree that the model can have, in ascending order.
pub fn kinds<T>(model: &Model<T>) -> Vec<Kind> {
    let mut kinds: Vec<Kind> = model.pairs.iter().filter(|pair| !pair.rigid()).map(|pair| kind(model, pair)).collect();
    kinds.retain(|kind| kind.sides != Sides::Apart);
    kinds.sort_unstable();
    kinds.dedup();
    kinds
}

/// The cone of a pair's contacts.
pub fn cone<T>(model: &Model<T>, pair: &Pair<T>) -> Cone {
    match model.options.cone {
        _ if pair.condim == 1 => Cone::Ray,
        options::Cone::Pyramidal => Cone::Pyramid,
        options::Cone::Elliptic => Cone::Ellipse,
    }
}

/// Strength, and minus the reference acceleration of each component, which have the given speeds. A pyramid's rows share
/// R = 2 μ₁² (1 + μ₁²) Â (1 - d)/d / impratio; friction rows of an elliptic cone have damping of their own.
#[inline(always)]
fn regularise<L: Lane>(grip: &Grip<L>, contact: Contact<'_, L>, speeds: &[L; 6], out: Numbers<'_, L>) {
    let Grip { invweight: weight, friction, impedance, .. } = grip;
    let (diagonal, factor) = if grip.cone == Cone::Pyramid {
        let mu2 = friction[0] * friction[0];
        (mu2.mul_add(*weight, *weight), (mu2 + mu2) * L::of(1.0 / grip.impratio))
    } else {
        (*weight, L::one())
    };
    let (d, normal) = dof_rows::row(impedance, contact.dist() - grip.margin, speeds[0], diagonal, factor);
    let b = if grip.cone == Cone::Ellipse { grip.friction_b } else { impedance.b };
    out.reference[0] = normal;
    for (reference, speed) in out.reference.iter_mut().zip(speeds).skip(1) {
        *reference = b * *speed;
    }
    let mu = if grip.cone == Cone::Pyramid { d * *weight } else { friction[0] * L::of((1.0 / grip.impratio).sqrt()) };
    let [f1, f2, f3, f4, f5] = *friction;
    *out.strength = [L::select(contact.dist().lt(grip.margin), d, L::zero()), mu, f1, f2, f3, f4, f5];
}
