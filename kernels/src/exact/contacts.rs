//! The derivative of contact forces by positions, velocities and accelerations.
//!
//! A contact's wrench depends on the poses of its links and on how they move. How its place, frame and distance change with a pose follows from the
//! narrow phase over dual numbers, for each of six steps of a link; how the wrench changes with these and with motions, from its law (`held`).
//!
//! The narrow phase of pairs without a formula in lanes finds numbers, no dual ones: how places, normals and distances change there is taken from a small
//! step to either side. All else is exact there, too.

use super::held::Held;
use super::rigid::{Rigid, ancestors, group};
use super::touch::{Slopes, Touches};
use crate::collision::{self, Collision, ConvexCollider, Found, Near, Slot};
use crate::lane::{Lane, LaneQuery, Mask, Tangent};
use crate::math::spatial::{Spatial, cross_force, cross_motion, dot6, lin, rot};
use crate::math::vec3::{add, build, column, cross, scale_add, sub, zero};
use crate::model::{Instance, Model, NONE, Pair, Shape, Sides};
use crate::position::Position;

/// How far a link is moved, m and rad, where the narrow phase has no dual numbers.
const STEP: f64 = 1e-6;

/// Room for the contacts of a pair.
#[derive(Clone, Debug)]
pub struct Contacts<L> {
    /// For pairs without a formula in lanes, if the model has some.
    single: Option<Box<(Collision<L>, Position<L>)>>,
    /// Rows about to begin or cease to act, or to slide.
    pub edges: L,
    found: Vec<Found<Tangent<L>>>,
    /// By point and side, how what is found changes by six steps of the link's pose.
    steps: Vec<[[Found<L>; 6]; 2]>,
    /// Contacts whose one side stands still.
    touches: Touches<L>,
    /// Of others: dofs that move the links against each other: of the second link (true) or of the first, root first.
    dofs: Vec<(usize, bool)>,
    /// Dofs that move both links alike.
    common: Vec<usize>,
    /// Columns of the Jacobian, of `dofs`.
    columns: Vec<[L; 6]>,
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
            steps: Vec::new(),
            touches: Touches::new(model),
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
            self.steps.resize(points, [[[L::zero(); 13]; 6]; 2]);
        }
        for (side, link) in links.into_iter().enumerate().filter(|(_, link)| *link != NONE) {
            for step in 0..6 {
                displace(position, places, link as usize, step);
                if near.class == NONE {
                    self.step_to_both_sides(model, near, convex, (places, link as usize, step));
                } else {
                    narrow(dual, near.pair, position, &mut self.found);
                }
                for point in slots.iter().map(|slot| slot.point as usize) {
                    let (to, found) = (&mut self.steps[point][side][step], &self.found[point]);
                    to.iter_mut().zip(found).for_each(|(to, x)| *to = x.rate);
                }
            }
            restore(position, places, link as usize);
        }
        let motion = |of: &[Spatial<L>]| links.map(|l| if l == NONE { zero() } else { of[l as usize] });
        let motions = [motion(&rigid.velocity), motion(&rigid.pull)];
        if pair.sides != Sides::One {
            self.list_dofs(&model, pair);
        }
        for point in slots.iter().map(|slot| slot.point as usize) {
            let found = self.found[point].map(|x| x.value);
            let held = Held::new((model, dual), places, near.pair, &found, &motions);
            self.edges += held.edges;
            if pair.sides == Sides::One {
                let side = usize::from(pair.link2 != NONE);
                self.touches.add((&held, side), &self.steps[point][side], rigid);
            } else {
                self.spread(&model, (places, rigid), (&held, point), slopes);
            }
        }
    }

    /// Adds what those contribute whose one side stands still, when all have been added.
    pub fn add_touches(
        &mut self,
        model: &Model<L::Real>,
        (places, rigid): (&Position<L>, &Rigid<L>),
        slopes: &mut Slopes<'_, L>,
    ) {
        self.touches.spread(model, (places, rigid), slopes);
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
        let dofs = &model.pair_dofs[pair.dofs.range()];
        self.dofs.extend(dofs.iter().map(|entry| (entry.dof as usize, entry.second)));
        let last = model.links[pair.link2 as usize].last_dof();
        if pair.sides == Sides::Two && last != NONE {
            let carriers = std::iter::once(last as usize).chain(ancestors(model, last as usize));
            self.common.extend(carriers.filter(|dof| !self.dofs.iter().any(|(own, _)| own == dof)));
        }
    }

    /// Adds what a contact contributes whose sides both move, column by column.
    fn spread(
        &mut self,
        model: &Model<L::Real>,
        (places, rigid): (&Position<L>, &Rigid<L>),
        (held, point): (&Held<L>, usize),
        slopes: &mut Slopes<'_, L>,
    ) {
        let (nv, width, dim) = (model.sizes.nv, slopes.width, held.dim);
        self.columns.clear();
        let column = |(dof, second): &(usize, bool)| held.components(usize::from(*second), &places.cdof[*dof]);
        self.columns.extend(self.dofs.iter().map(column));
        let wrenches = [0, 1].map(|side| held.own_wrench(side));
        let changes = self.steps[point].map(|steps| steps.map(|rates| held.changed(&rates, [zero(); 2])));
        let own = self.dofs.iter().map(|(j, second)| (*j, [!second, *second]));
        // Dofs that carry both links turn the contact as a whole, but tangents follow the world's axes.
        let both = self.common.iter().map(|j| (*j, [true; 2]));
        for (n, (j, moves)) in own.chain(both).enumerate() {
            let s = &places.cdof[j];
            let (mut speeds, mut pulls, mut posed) = ([L::zero(); 6], [L::zero(); 6], [zero(); 2]);
            for side in (0..2).filter(|side| moves[*side]) {
                let link = held.links[side] as usize;
                // A step of the dof turns the link, and its motion as far as it comes from here on.
                let turned =
                    |all: &Spatial<L>, before: &Spatial<L>| held.components(side, &cross_motion(s, &sub(all, before)));
                speeds = add(&speeds, &turned(&rigid.velocity[link], &rigid.before[j]));
                pulls = add(&pulls, &turned(&rigid.pull[link], &rigid.pull_before[j]));
                for (change, s) in changes[side].iter().zip(s) {
                    posed = [0, 1].map(|of| scale_add(*s, &change[of], &posed[of]));
                }
            }
            let moved = add(&held.sped(&speeds), &held.pulled(&pulls));
            let changes: [Spatial<L>; 2] = [0, 1].map(|side| add(&posed[side], &held.wrench(side, &moved)));
            // What the step carries turns with it.
            let carried = wrenches.map(|wrench| cross_force(s, &wrench));
            let first_carried = group(model, j).start;
            let own = self.columns.get(n).map(|column| (held.sped(column), held.pulled(column)));
            for ((i, second), row) in self.dofs.iter().zip(&self.columns) {
                let (i, of) = (*i, usize::from(*second));
                let mut change = changes[of];
                if moves[of] && i >= first_carried {
                    change = sub(&change, &carried[of]);
                }
                slopes.by_state[width * i + j] -= dot6(&places.cdof[i], &change);
                if let Some((sped, pulled)) = &own {
                    let times = |f: &[L; 6]| (0..dim).fold(L::zero(), |sum, k| row[k].mul_add(f[k], sum));
                    slopes.by_state[width * i + nv + j] -= times(sped);
                    if j <= i {
                        slopes.hessian[model.rows.at(i, j)] -= times(pulled);
                    }
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

/// How a link's place and orientation change with a step: a turn about the tree's origin, in place, or a shift.
fn moved<L: Lane>(places: &Position<L>, link: usize, step: usize) -> ([L; 3], [L; 9]) {
    let axis = |k: usize| build(|i| if i == k { L::one() } else { L::zero() });
    if step >= 3 {
        return (axis(step - 3), [L::zero(); 9]);
    }
    let (turn, matrix) = (axis(step), &places.rot[link]);
    let columns = [0, 1, 2].map(|k| cross(&turn, &column(matrix, k)));
    (cross(&turn, &places.pos[link]), build(|at| columns[at % 3][at / 3]))
}

/// Moves a link by the dual unit.
fn displace<L: Lane>(position: &mut Position<Tangent<L>>, places: &Position<L>, link: usize, step: usize) {
    let (pos, rot) = moved(places, link, step);
    position.pos[link] = build(|k| Tangent::new(places.pos[link][k], pos[k]));
    position.rot[link] = build(|k| Tangent::new(places.rot[link][k], rot[k]));
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
