//! The derivative of contact forces by positions, velocities and accelerations.
//!
//! A contact's wrench depends on the poses of its links and on how they move. Its derivative by a pose follows from the narrow phase and the law of
//! the contact over dual numbers, one for each of six steps of a link. By motions it is that of the law alone: components change by J, forces by minus
//! the contact's stiffness, reference accelerations by its damping.
//!
//! The narrow phase of pairs without a formula in lanes finds numbers, no dual ones: how places, normals and distances change there is taken from a small
//! step to either side. All else is exact there, too.

use super::rigid::{Rigid, ancestors, group};
use crate::collision::{self, Collision, Contact, ConvexCollider, Found, Near, Slot};
use crate::constraint::{self, Cone, Law};
use crate::lane::{Lane, LaneQuery, Mask, Tangent};
use crate::math::spatial::{Spatial, cross_force, cross_motion, dot6, join, lin, rot};
use crate::math::vec3::{add, column, cross, cross_add, dot, row, scale_add, sub, zero};
use crate::model::{Instance, Model, NONE, Pair, Shape, Sides};
use crate::position::Position;
use crate::solver::{cone, hessian};

/// What is known of a contact: how the wrenches on its first and second link change by six steps of the first link's pose, then of the second's.
type Changes<L> = [[Spatial<L>; 2]; 12];

/// How far a link is moved, m and rad, where the narrow phase has no dual numbers.
const STEP: f64 = 1e-6;
/// Part of what a row's force depends on, within which it is about to begin or to cease to act, or to slide.
pub(super) const EDGE: f64 = 1e-6;

/// Room for the contacts of a pair.
#[derive(Clone, Debug)]
pub struct Contacts<L> {
    /// For pairs without a formula in lanes, if the model has some.
    single: Option<Box<(Collision<L>, Position<L>)>>,
    /// Rows about to begin or cease to act, or to slide.
    pub edges: L,
    found: Vec<Found<Tangent<L>>>,
    changes: Vec<Changes<L>>,
    /// Dofs that move the links against each other: of the second link (true) or of the first, root first.
    dofs: Vec<(usize, bool)>,
    /// Dofs that move both links alike.
    common: Vec<usize>,
    /// Columns of the Jacobian, of `dofs`.
    columns: Vec<[L; 6]>,
}

/// Where derivatives of M a + c - Jᵀf are added up.
#[derive(Debug)]
pub struct Slopes<'a, L> {
    /// By positions, velocities, and more, rows first.
    pub by_state: &'a mut [L],
    /// Columns of that.
    pub width: usize,
    /// By accelerations.
    pub by_acceleration: &'a mut [L],
}

/// How a contact's components and force are at the nominal state.
struct Held<L> {
    rows: [[Spatial<L>; 6]; 2],
    dim: usize,
    force: [L; 6],
    damping: [L; 6],
    stiffness: cone::Stiffness<L>,
    /// How many of its rows are about to begin or cease to act, or to slide.
    edges: L,
}

impl<L: LaneQuery> Contacts<L> {
    /// Room for a model.
    pub fn new(model: &Model<L::Real>) -> Self {
        let formula = |pair: &Pair<L::Real>| {
            let [a, b] = pair.geoms().map(|geom| model.geoms[geom].shape);
            collision::in_lanes((a, b))
        };
        let room = || Box::new((Collision::new(model), Position::new(&model.sizes)));
        Contacts {
            single: (!model.pairs.iter().all(formula)).then(room),
            edges: L::zero(),
            found: Vec::new(),
            changes: Vec::new(),
            dofs: Vec::new(),
            common: Vec::new(),
            columns: Vec::new(),
        }
    }

    /// Adds what the contacts of a pair, those of `slots`, contribute. `position` is that of `places`, at rest; it is left so.
    pub fn add(
        &mut self,
        (model, dual): (Instance<'_, L>, Instance<'_, Tangent<L>>),
        near: &Near,
        (slots, convex): (&[Slot], &dyn ConvexCollider),
        (places, position, rigid): (&Position<L>, &mut Position<Tangent<L>>, &Rigid<L>),
        slopes: &mut Slopes<'_, L>,
    ) {
        let pair = &model.pairs[near.pair as usize];
        if pair.rigid() {
            return;
        }
        let links = [pair.link1, pair.link2];
        let points = near.points as usize;
        if self.found.len() < points {
            self.found.resize(points, [Tangent::zero(); 13]);
            self.changes.resize(points, [[zero(); 2]; 12]);
        }
        let motion = |of: &[Spatial<L>]| links.map(|l| if l == NONE { zero() } else { of[l as usize] });
        let motions = [motion(&rigid.velocity), motion(&rigid.pull)];
        let still = motions.map(|both| both.map(|motion| motion.map(Tangent::still)));
        for (side, link) in links.into_iter().enumerate().filter(|(_, link)| *link != NONE) {
            for step in 0..6 {
                displace(position, places, link as usize, step);
                if near.class == NONE {
                    self.step_to_both_sides(model, near, convex, (places, link as usize, step));
                } else {
                    narrow(dual, near.pair, position, &mut self.found);
                }
                for slot in slots {
                    let (point, changes) = (slot.point as usize, &mut self.changes);
                    let change = &mut changes[point][6 * side + step];
                    wrenches(dual, position, near.pair, &self.found[point], &still, change);
                }
            }
            restore(position, places, link as usize);
        }
        self.list_dofs(&model, pair);
        for slot in slots {
            let found = self.found[slot.point as usize].map(|x| x.value);
            let held = hold(model, places, near.pair, &found, &motions);
            self.edges += held.edges;
            self.spread(&model, (places, rigid), links, slot.point as usize, &held, slopes);
        }
    }

    /// Finds the contacts of a pair without a formula in lanes, and how they change, from small steps of a link.
    fn step_to_both_sides(
        &mut self,
        model: Instance<'_, L>,
        near: &Near,
        convex: &dyn ConvexCollider,
        (places, link, step): (&Position<L>, usize, usize),
    ) {
        let Some(single) = &mut self.single else { return };
        let (collision, position) = &mut **single;
        let near = &Near { first: 0, ..*near };
        collision.found.resize(near.points as usize, [L::zero(); 13]);
        (0..Position::<L>::COUNT).for_each(|n| position.field_mut(n).copy_from_slice(places.field(n)));
        for (sign, half) in [(0.0, 0.0), (STEP, 0.5 / STEP), (-STEP, -0.5 / STEP)] {
            let (pos, rot) = moved(places, link, step);
            for (to, (x, rate)) in position.pos[link].iter_mut().zip(places.pos[link].iter().zip(pos)) {
                *to = L::of(sign).mul_add(rate, *x);
            }
            for (to, (x, rate)) in position.rot[link].iter_mut().zip(places.rot[link].iter().zip(rot)) {
                *to = L::of(sign).mul_add(rate, *x);
            }
            collision.world_by_world(model, near, position, convex);
            for (to, found) in self.found.iter_mut().zip(&collision.found[..near.points as usize]) {
                for (to, x) in to.iter_mut().zip(found) {
                    *to = match sign {
                        0.0 => Tangent::still(*x),
                        _ => Tangent::new(to.value, L::of(half).mul_add(*x, to.rate)),
                    };
                }
            }
        }
    }

    /// The dofs that move the links of a pair, against each other or alike.
    fn list_dofs(&mut self, model: &Model<L::Real>, pair: &Pair<L::Real>) {
        self.dofs.clear();
        self.common.clear();
        let second = pair.link2 != NONE;
        let last = model.links[if second { pair.link2 } else { pair.link1 } as usize].last_dof();
        let carriers = || {
            (last != NONE)
                .then_some(last as usize)
                .into_iter()
                .flat_map(|i| std::iter::once(i).chain(ancestors(model, i)))
        };
        if pair.sides == Sides::One {
            self.dofs.extend(carriers().map(|dof| (dof, second)));
            return self.dofs.reverse();
        }
        let dofs = &model.pair_dofs[pair.dofs.range()];
        self.dofs.extend(dofs.iter().map(|entry| (entry.dof as usize, entry.second)));
        if pair.sides == Sides::Two {
            self.common.extend(carriers().filter(|dof| !self.dofs.iter().any(|(own, _)| own == dof)));
        }
    }

    /// Adds what a contact contributes, column by column.
    fn spread(
        &mut self,
        model: &Model<L::Real>,
        (places, rigid): (&Position<L>, &Rigid<L>),
        links: [u32; 2],
        point: usize,
        held: &Held<L>,
        slopes: &mut Slopes<'_, L>,
    ) {
        let Held { rows, dim, force, damping, stiffness, .. } = held;
        let (nv, width) = (model.sizes.nv, slopes.width);
        let signed = |second: bool, x: L| if second { x } else { -x };
        let rates = |second: bool, motion: &Spatial<L>| -> [L; 6] {
            std::array::from_fn(|i| {
                if i < *dim { signed(second, dot6(&rows[usize::from(second)][i], motion)) } else { L::zero() }
            })
        };
        let wrench = |second: bool, force: &[L; 6]| {
            let rows = &rows[usize::from(second)];
            (0..*dim).fold(zero(), |sum, i| scale_add(signed(second, force[i]), &rows[i], &sum))
        };
        let pushed = |rates: [L; 6]| hessian::times(stiffness, &rates[..*dim]).map(|f| -f);
        let damped = |rates: &[L; 6]| -> [L; 6] { std::array::from_fn(|i| damping[i] * rates[i]) };
        self.columns.clear();
        self.columns.extend(self.dofs.iter().map(|(dof, second)| rates(*second, &places.cdof[*dof])));
        let held_wrench = [false, true].map(|second| wrench(second, force));
        let own = self.dofs.iter().map(|(j, second)| (*j, [!second, *second]));
        // Dofs that carry both links turn the contact as a whole, but tangents follow the world's axes.
        let both = self.common.iter().map(|j| (*j, [true; 2]));
        for (n, (j, moves)) in own.chain(both).enumerate() {
            let s = &places.cdof[j];
            let (mut speeds, mut pulls, mut posed) = ([L::zero(); 6], [L::zero(); 6], [zero(); 2]);
            for second in [false, true].into_iter().filter(|second| moves[usize::from(*second)]) {
                let (side, link) = (usize::from(second), links[usize::from(second)] as usize);
                // A step of the dof turns the link, and its motion as far as it comes from here on.
                let turned = |all: &Spatial<L>, before: &Spatial<L>| rates(second, &cross_motion(s, &sub(all, before)));
                speeds = add(&speeds, &turned(&rigid.velocity[link], &rigid.before[j]));
                pulls = add(&pulls, &turned(&rigid.pull[link], &rigid.pull_before[j]));
                for (step, s) in self.changes[point][6 * side..][..6].iter().zip(s) {
                    posed = [0, 1].map(|of| scale_add(*s, &step[of], &posed[of]));
                }
            }
            let moved = pushed(add(&damped(&speeds), &pulls));
            let changes: [Spatial<L>; 2] = [false, true].map(|second| {
                let of = usize::from(second);
                if links[of] == NONE { zero() } else { add(&posed[of], &wrench(second, &moved)) }
            });
            // What the step carries turns with it.
            let carried = held_wrench.map(|held| cross_force(s, &held));
            let first_carried = group(model, j).start;
            let own = self.columns.get(n).map(|column| (pushed(damped(column)), pushed(*column)));
            for ((i, second), row) in self.dofs.iter().zip(&self.columns) {
                let (i, of) = (*i, usize::from(*second));
                let mut change = changes[of];
                if moves[of] && i >= first_carried {
                    change = sub(&change, &carried[of]);
                }
                slopes.by_state[width * i + j] -= dot6(&places.cdof[i], &change);
                if let Some((sped, pulled)) = &own {
                    let times = |f: &[L; 6]| (0..*dim).fold(L::zero(), |sum, k| row[k].mul_add(f[k], sum));
                    slopes.by_state[width * i + nv + j] -= times(sped);
                    slopes.by_acceleration[nv * i + j] -= times(pulled);
                }
            }
        }
    }
}

/// The contacts of a pair, wherever they are.
fn narrow<L: Lane>(
    model: Instance<'_, Tangent<L>>,
    pair: u32,
    position: &Position<Tangent<L>>,
    found: &mut [Found<Tangent<L>>],
) {
    let everywhere = L::Mask::splat(true);
    if collision::shapes(&model, pair) == (Shape::Capsule, Shape::Capsule) {
        collision::narrow_parallel(model, pair, everywhere, position, found);
    } else {
        collision::narrow(model, pair, everywhere, position, found);
    }
}

/// Places of a contact relative to the origins of its links' trees.
#[inline(always)]
fn places_of<L: Lane>(model: &Model<L::Real>, position: &Position<L>, pair: u32, at: [L; 3]) -> [[L; 3]; 2] {
    let Pair { link1, link2, .. } = model.pairs[pair as usize];
    let both = link1 != NONE && link2 != NONE;
    [if both { position.moved(model, &at, link2, link1) } else { at }, at]
}

/// Components of the second link's motion at a contact less the first's.
#[inline(always)]
fn components<L: Lane>(
    contact: Contact<'_, L>,
    (links, at): ([u32; 2], &[[L; 3]; 2]),
    motions: &[Spatial<L>; 2],
    dim: usize,
) -> [L; 6] {
    let (mut shift, mut turn) = (zero(), zero());
    for side in (0..2).filter(|side| links[*side] != NONE) {
        let (w, v) = (rot(&motions[side]), cross_add(&rot(&motions[side]), &at[side], &lin(&motions[side])));
        (shift, turn) = if side == 1 { (add(&shift, &v), add(&turn, &w)) } else { (sub(&shift, &v), sub(&turn, &w)) };
    }
    let frame = contact.frame();
    std::array::from_fn(|i| match i {
        i if i >= dim => L::zero(),
        0..3 => dot(&row(frame, i), &shift),
        _ => dot(&row(frame, i - 3), &turn),
    })
}

/// J a - a_ref of a contact whose links have velocities and accelerations, and what its force depends on.
#[inline(always)]
fn reached<L: Lane>(
    model: Instance<'_, L>,
    (pair, contact): (u32, Contact<'_, L>),
    at: &[[L; 3]; 2],
    [velocity, pull]: &[[Spatial<L>; 2]; 2],
) -> (constraint::Regular<L>, [L; 6]) {
    let Pair { link1, link2, condim, .. } = model.pairs[pair as usize];
    let (links, dim) = ([link1, link2], condim as usize);
    let speeds = components(contact, (links, at), velocity, dim);
    let regular = constraint::regular(model, pair as usize, contact, &speeds);
    (regular, add(&components(contact, (links, at), pull, dim), &regular.reference))
}

/// How the wrenches on the links of a contact change.
fn wrenches<L: Lane>(
    model: Instance<'_, Tangent<L>>,
    position: &Position<Tangent<L>>,
    pair: u32,
    found: &Found<Tangent<L>>,
    motions: &[[Spatial<Tangent<L>>; 2]; 2],
    change: &mut [Spatial<L>; 2],
) {
    let (contact, number) = (Contact(found), &model.pairs[pair as usize]);
    let at = places_of(&model, position, pair, contact.pos());
    let (regular, y) = reached(model, (pair, contact), &at, motions);
    let (dim, mut force) = (number.condim as usize, [Tangent::zero(); 6]);
    let law = Law { cone: constraint::cone(&model, number), strength: &regular.strength };
    cone::force(law, &y[..dim], &mut force[..dim]);
    let along = |from: usize, to: usize| {
        (from..to).fold(zero(), |sum, i| scale_add(force[i], &row(contact.frame(), i % 3), &sum))
    };
    let (push, torque) = (along(0, dim.min(3)), along(3, dim.max(3)));
    let links = [number.link1, number.link2];
    for side in (0..2).filter(|side| links[*side] != NONE) {
        let wrench = join(&cross_add(&at[side], &push, &torque), &push);
        change[side] = wrench.map(|x: Tangent<L>| if side == 1 { x.rate } else { -x.rate });
    }
}

/// How a contact holds its links.
fn hold<L: Lane>(
    model: Instance<'_, L>,
    position: &Position<L>,
    pair: u32,
    found: &Found<L>,
    motions: &[[Spatial<L>; 2]; 2],
) -> Held<L> {
    let (contact, number) = (Contact(found), &model.pairs[pair as usize]);
    let at = places_of(&model, position, pair, contact.pos());
    let (regular, y) = reached(model, (pair, contact), &at, motions);
    let (dim, mut force) = (number.condim as usize, [L::zero(); 6]);
    let law = Law { cone: constraint::cone(&model, number), strength: &regular.strength };
    cone::force(law, &y[..dim], &mut force[..dim]);
    let reference = &regular.reference;
    let sizes = std::array::from_fn(|i| (y[i] - reference[i]).abs() + reference[i].abs());
    Held {
        rows: at.map(|at| std::array::from_fn(|i| constraint::motion_row(contact, &at, i))),
        dim,
        force,
        damping: regular.damping,
        stiffness: cone::stiffness(law, &y[..dim]),
        edges: edges(law, &y[..dim], &sizes),
    }
}

/// How many rows of a contact are within [`EDGE`] of where they begin or cease to act, or to slide; `sizes` are those of what its components
/// are the sums of.
fn edges<L: Lane>(law: Law<'_, L>, y: &[L], sizes: &[L; 6]) -> L {
    let near = |x: L, size: L| L::select(x.abs().le(L::of(EDGE) * size), L::one(), L::zero());
    let mut count = L::zero();
    match law.cone {
        Cone::Ray => count = near(y[0], sizes[0]),
        Cone::Pyramid => {
            for j in 1..y.len() {
                let (mu, size) = (law.friction(j), law.friction(j).mul_add(sizes[j], sizes[0]));
                count += near(mu.mul_add(y[j], y[0]), size) + near(mu.neg_mul_add(y[j], y[0]), size);
            }
        }
        Cone::Ellipse => {
            let slip = |of: &[L]| {
                (1..y.len())
                    .fold(L::zero(), |sum, j| (law.friction(j) * of[j]).mul_add(law.friction(j) * of[j], sum))
                    .sqrt()
            };
            let (normal, slips) = (law.mu() * y[0], slip(y));
            let size = law.mu().mul_add(sizes[0], slip(sizes));
            count = near(law.mu().neg_mul_add(slips, normal), size) + near(law.mu().mul_add(normal, slips), size);
        }
    }
    L::select(law.d().gt(L::zero()), count, L::zero())
}

/// How a link's place and orientation change with a step: a turn about the tree's origin, in place, or a shift.
fn moved<L: Lane>(places: &Position<L>, link: usize, step: usize) -> ([L; 3], [L; 9]) {
    let axis = |k: usize| std::array::from_fn(|i| if i == k { L::one() } else { L::zero() });
    if step >= 3 {
        return (axis(step - 3), [L::zero(); 9]);
    }
    let (turn, matrix) = (axis(step), &places.rot[link]);
    let columns = [0, 1, 2].map(|k| cross(&turn, &column(matrix, k)));
    (cross(&turn, &places.pos[link]), std::array::from_fn(|at| columns[at % 3][at / 3]))
}

/// Moves a link by the dual unit.
fn displace<L: Lane>(position: &mut Position<Tangent<L>>, places: &Position<L>, link: usize, step: usize) {
    let (pos, rot) = moved(places, link, step);
    position.pos[link] = std::array::from_fn(|k| Tangent::new(places.pos[link][k], pos[k]));
    position.rot[link] = std::array::from_fn(|k| Tangent::new(places.rot[link][k], rot[k]));
}

/// Puts a link back to rest.
fn restore<L: Lane>(position: &mut Position<Tangent<L>>, places: &Position<L>, link: usize) {
    position.pos[link] = places.pos[link].map(Tangent::still);
    position.rot[link] = places.rot[link].map(Tangent::still);
}

/// Adds what a wrench contributes that a force at a place makes on a link, both as they are in the world.
pub fn add_force<L: Lane>(
    model: &Model<L::Real>,
    places: &Position<L>,
    (link, at, wrench): (usize, &[L; 3], &Spatial<L>),
    (width, by_state): (usize, &mut [L]),
) {
    let last = model.links[link].last_dof();
    if last == NONE {
        return;
    }
    let dofs = || std::iter::once(last as usize).chain(ancestors(model, last as usize));
    for j in dofs() {
        let s = &places.cdof[j];
        let moved = [0, 1, 2].map(|k| lin(s)[k] + cross(&rot(s), at)[k]);
        let torque = cross(&moved, &lin(wrench));
        let change = [torque[0], torque[1], torque[2], L::zero(), L::zero(), L::zero()];
        let carried = sub(&change, &cross_force(s, wrench));
        for i in dofs() {
            let change = if i >= group(model, j).start { &carried } else { &change };
            by_state[width * i + j] -= dot6(&places.cdof[i], change);
        }
    }
}
