//! Exact derivatives: of inverse dynamics, of the acceleration, and of the next state.
//!
//! At the solver's minimum the residual r = M a + c - other forces - Jᵀf(J a - a_ref) vanishes. So the acceleration changes by
//! da = -H⁻¹ dr, where dr is the change of the residual with `a` held, and H = ∂r/∂a, the Hessian of the solver's cost: no second solve. Where rows begin or
//! cease to act, or to slide, there are two derivatives; the one that is found is that of the rows that act.
//!
//! Rigid bodies' part of dr is analytic (`rigid`), that of contacts follows from dual numbers pose by pose (`contacts`), all else from dual numbers
//! (`rest`).

mod contacts;
mod held;
mod missing;
mod rest;
mod rigid;
mod sides;
mod step;
mod touch;

pub use missing::missing;
pub use sides::{STRIP, Strip};

use self::contacts::Contacts;
use self::rest::{Anew, Rest};
use self::rigid::{Motions, Rigid};
use self::touch::Slopes;
use crate::collision::{ConvexCollider, Near, Slot};
use crate::inertia::{self, Inertia};
use crate::lane::{Lane, LaneQuery, Tangent};
use crate::math::spatial::join;
use crate::math::vec3::{add, cross, mul_add, splat};
use crate::model::{Actuator, Instance, Model, NONE};
use crate::options::Integrator;
use crate::position::{self, Position};
use crate::state::{Applied, State};
use crate::tendon::Tendons;

/// Of what derivatives are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// The force of inverse dynamics.
    Inverse,
    /// The acceleration.
    Acceleration,
    /// The next state.
    Transition,
}

/// Around what.
pub struct Given<'a, L: Lane> {
    /// State.
    pub state: &'a State<L>,
    /// Forces from outside.
    pub applied: Option<&'a Applied<L>>,
    /// The solver's acceleration, or that of inverse dynamics.
    pub qacc: &'a [L],
    /// The pairs that are near.
    pub near: &'a [Near],
    /// Their contacts.
    pub slots: &'a [Slot],
    /// Collider of the convex pairs without a formula.
    pub convex: &'a dyn ConvexCollider,
}

/// Takes derivatives by some columns: the first of these, how many there are, and the rows.
pub type Taker<'a, L> = dyn FnMut(usize, usize, &[Strip<L>]) + 'a;

/// Whether a step's acceleration is not the solver's.
fn is_implicit<T>(model: &Model<T>) -> bool {
    match model.options.integrator {
        Integrator::Euler => model.features.implicit_damping,
        Integrator::Implicit | Integrator::ImplicitFast => true,
        Integrator::Rk4 | Integrator::Discrete | Integrator::Midpoint => false,
    }
}

/// Room for the derivatives of a block's worlds, and these.
#[derive(Clone, Debug)]
pub struct Exact<L: Lane> {
    position: Position<L>,
    dual_position: Position<Tangent<L>>,
    inertia: Inertia<L>,
    rigid: Rigid<L>,
    /// The same without velocities and gravity, with the acceleration that a step adds to the solver's.
    excess: Rigid<L>,
    tendons: Tendons<L>,
    contacts: Contacts<L>,
    rest: Box<Rest<L>>,
    step: step::Step<L>,
    /// Of the residual: nv rows; columns by positions, velocities, activations, controls.
    slopes: Vec<L>,
    /// Whether contacts or others join dofs that the inertia matrix does not.
    filled: bool,
    /// Of the residual by accelerations: stored as the inertia matrix.
    hessian: Vec<L>,
    /// Of (M - h D) a⁺ - M a in an implicit step.
    excess_slopes: Vec<L>,
    /// Of next activations.
    act_slopes: Vec<L>,
}

impl<L: LaneQuery> Exact<L> {
    /// Room for a model.
    pub fn new(model: &Model<L::Real>) -> Self {
        let (sizes, zero) = (&model.sizes, L::zero());
        let (nv, na, width) = (sizes.nv, sizes.na, width(model));
        Exact {
            position: Position::new(sizes),
            dual_position: Position::new(sizes),
            inertia: Inertia::new(sizes),
            rigid: Rigid::new(sizes),
            excess: Rigid::new(sizes),
            tendons: Tendons::new(sizes),
            contacts: Contacts::new(model),
            rest: Box::new(Rest::new(model)),
            step: step::Step::new(model),
            slopes: vec![zero; nv * width],
            filled: false,
            hessian: vec![zero; sizes.nm],
            excess_slopes: vec![zero; nv * width],
            act_slopes: vec![zero; na * width],
        }
    }

    /// Finds the derivatives of a model that [`missing`] says nothing of, and hands them out by [`STRIP`]s of columns: the first of these, how many
    /// there are, and the rows. Columns are positions, velocities, activations, controls; of inverse dynamics positions, velocities, accelerations.
    /// Rows are positions, velocities and activations of the next state, or dofs.
    pub fn differentiate(&mut self, of: Of, model: Instance<'_, L>, given: &Given<'_, L>, out: &mut Taker<'_, L>) {
        self.rest.driven = of != Of::Inverse;
        self.rest.load(model, given.state, given.applied, given.qacc);
        position::kinematics(model, given.state.into(), &mut self.position);
        if !model.tendons.is_empty() {
            let State { qpos, qvel, .. } = given.state;
            crate::tendon::tendons(&model, &self.position, qpos, qvel, &mut self.tendons);
        }
        inertia::crb(model, &self.position, &self.tendons, &mut self.inertia);
        self.contacts.edges = L::zero();
        self.slopes.fill(L::zero());
        self.excess_slopes.fill(L::zero());
        let Exact { position, inertia, rigid, .. } = self;
        let motions = Motions { qvel: &given.state.qvel, qacc: given.qacc, gravity: true };
        rigid::move_links(model, (position, inertia), motions, rigid);
        let implicit = of == Of::Transition && is_implicit(&model);
        if implicit {
            self.find_over(model, given);
        }
        if !self.rest.reach.rigid {
            self.rigid_bodies(model, given, implicit);
        }
        self.add_contacts(model, given);
        if self.rest.reach.local {
            self.rest_at_once(&model)
        } else {
            self.rest_by_columns(&model)
        }
        self.hand_out(of, model, given, out);
    }

    /// How many rows of each world are so near to where they begin or cease to act, or to slide, that there may be another derivative.
    pub fn edges(&self, model: &Model<L::Real>) -> L {
        self.contacts.edges + self.rest.edges(model)
    }

    /// What rigid bodies contribute, and forces on them from outside.
    fn rigid_bodies(&mut self, model: Instance<'_, L>, given: &Given<'_, L>, implicit: bool) {
        let Exact { position, inertia, rigid, excess, slopes, excess_slopes, .. } = self;
        let width = width(&model);
        rigid::differentiate(&model, (position, inertia, rigid), true, (width, slopes));
        let applied = given.applied.into_iter().flat_map(|applied| model.bodies.iter().zip(&applied.xfrc_applied));
        for (body, x) in applied.filter(|(body, _)| body.link != NONE) {
            let l = body.link as usize;
            let at = mul_add(&position.rot[l], &splat(&body.com), &position.pos[l]);
            let (push, torque) = ([x[0], x[1], x[2]], [x[3], x[4], x[5]]);
            let wrench = join(&add(&torque, &cross(&at, &push)), &push);
            contacts::add_force(&model, position, (l, &at, &wrench), (width, slopes));
        }
        if implicit {
            let (still, added) = self.step.room_for_motions();
            let over = self.rest.over.iter().zip(given.qacc);
            added.iter_mut().zip(over).for_each(|(added, (over, a))| *added = over.value - *a);
            let motions = Motions { qvel: still, qacc: added, gravity: false };
            rigid::move_links(model, (position, inertia), motions, excess);
            rigid::differentiate(&model, (position, inertia, excess), false, (width, excess_slopes));
        }
    }

    /// What contacts contribute, and M.
    fn add_contacts(&mut self, model: Instance<'_, L>, given: &Given<'_, L>) {
        let Exact { position, dual_position, inertia, rigid, contacts, rest, slopes, hessian, .. } = self;
        hessian.copy_from_slice(&inertia.m);
        let mut slopes = Slopes { by_state: slopes, width: width(&model), hessian };
        for n in 0..Position::<L>::COUNT {
            let still = position.field(n).iter().map(|x| Tangent::still(*x));
            dual_position.field_mut(n).iter_mut().zip(still).for_each(|(to, x)| *to = x);
        }
        let instances = (model, rest.instance(model.model));
        let mut slots = given.slots;
        for near in given.near {
            let count = slots.iter().take_while(|slot| slot.pair == near.pair).count();
            let (own, others) = slots.split_at(count);
            slots = others;
            if !own.is_empty() {
                contacts.add(instances, near, (own, given.convex), (position, dual_position, rigid), &mut slopes);
            }
        }
        contacts.add_touches(&model, (position, rigid), &mut slopes);
    }

    /// All else where forces are local: all joints at once, dofs one after the other whose forces depend on each other.
    fn rest_at_once(&mut self, model: &Model<L::Real>) {
        let (nv, na, width) = (model.sizes.nv, model.sizes.na, width(model));
        let rounds = self.rest.companions.iter().map(|dofs| dofs.len()).max().unwrap_or(0);
        for (from, first) in [(Anew::Position, 0), (Anew::Velocity, nv)] {
            for round in 0..rounds {
                self.rest.rest();
                for i in 0..nv {
                    match from {
                        _ if self.rest.companions[i].start + round != i => {}
                        Anew::Velocity => self.rest.state.qvel[i].rate = L::one(),
                        _ => self.rest.move_position(model, i),
                    }
                }
                self.rest.evaluate(model, from);
                for i in 0..nv {
                    // A force belongs to that of the companions which was moved.
                    let Some(j) = self.rest.companions[i].clone().nth(round) else { continue };
                    self.slopes[width * i + first + j] += self.rest.found.residual[i];
                    self.excess_slopes[width * i + first + j] += self.rest.found.excess[i];
                }
            }
        }
        self.rest.stiffen(model, &mut self.hessian);
        self.inputs_at_once(model, 2 * nv, na);
    }

    /// Activations and controls: all at once whose actuators act on different joints.
    fn inputs_at_once(&mut self, model: &Model<L::Real>, first: usize, na: usize) {
        let width = width(model);
        let dof = |a: usize| actuator_dof(model, &model.actuators[a]);
        let nu = model.actuators.len();
        let turn = |a: usize| (0..a).filter(|b| dof(*b) == dof(a)).count();
        let rounds = (0..nu).map(turn).max().map_or(0, |most| most + 1);
        self.act_slopes.fill(L::zero());
        for round in 0..rounds {
            for controls in [false, true] {
                let act = |a: usize| Some(model.actuators[a].act as usize).filter(|act| *act < na);
                let column = |a: usize| if controls { Some(first + na + a) } else { act(a).map(|act| first + act) };
                self.rest.rest();
                let own = || (0..nu).filter(|a| turn(*a) == round && column(*a).is_some());
                for a in own() {
                    let state = &mut self.rest.state;
                    match act(a) {
                        _ if controls => state.ctrl[a].rate = L::one(),
                        Some(act) => state.act[act].rate = L::one(),
                        None => {}
                    }
                }
                if own().next().is_none() {
                    continue;
                }
                self.rest.evaluate(model, Anew::Input);
                for a in own() {
                    let (i, Some(column)) = (dof(a), column(a)) else { continue };
                    self.slopes[width * i + column] += self.rest.found.residual[i];
                    self.excess_slopes[width * i + column] += self.rest.found.excess[i];
                    if let Some(act) = act(a) {
                        self.act_slopes[width * act + column] += self.rest.found.act[act];
                    }
                }
            }
        }
    }

    /// All else column by column.
    fn rest_by_columns(&mut self, model: &Model<L::Real>) {
        let (nv, na, width) = (model.sizes.nv, model.sizes.na, width(model));
        self.rest.rest();
        self.rest.evaluate(model, Anew::Position);
        self.act_slopes.fill(L::zero());
        self.rest.stiffen(model, &mut self.hessian);
        // Positions last: what they leave behind is not at rest.
        for column in (0..width).rev() {
            self.rest.rest();
            let from = if column >= 2 * nv + na {
                self.rest.state.ctrl[column - 2 * nv - na].rate = L::one();
                Anew::Input
            } else if column >= 2 * nv {
                self.rest.state.act[column - 2 * nv].rate = L::one();
                Anew::Input
            } else if column >= nv {
                self.rest.state.qvel[column - nv].rate = L::one();
                Anew::Velocity
            } else {
                self.rest.move_position(model, column);
                Anew::Position
            };
            self.rest.evaluate(model, from);
            for i in 0..nv {
                self.slopes[width * i + column] += self.rest.found.residual[i];
                self.excess_slopes[width * i + column] += self.rest.found.excess[i];
            }
            (0..na).for_each(|i| self.act_slopes[width * i + column] = self.rest.found.act[i]);
        }
    }
}

/// The dof on which an actuator acts that acts on one alone.
fn actuator_dof<T>(model: &Model<T>, actuator: &Actuator<T>) -> usize {
    model.moment_dofs[actuator.moments.range().start].dof as usize
}

/// Columns of the derivatives: positions, velocities, activations, controls.
pub fn width<T>(model: &Model<T>) -> usize {
    2 * model.sizes.nv + model.sizes.na + model.sizes.nu
}
