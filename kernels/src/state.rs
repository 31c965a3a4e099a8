//! What a world is: the state that is kept, and the status of the world.

use crate::fields::fields;
use crate::lane::Lane;
use crate::model::{Model, NONE};

fields! {
    /// State of the worlds of one block: everything that must be kept to continue a simulation.
    pub struct State(sizes) {
        /// Time, s.
        pub time: Vec<L> = 1,
        /// Positions; m, rad, quaternions (w, x, y, z).
        pub qpos: Vec<L> = sizes.nq,
        /// Velocities; m/s, rad/s.
        pub qvel: Vec<L> = sizes.nv,
        /// Activations.
        pub act: Vec<L> = sizes.na,
        /// Histories of actuators' controls and of sensors, as MuJoCo lays them out: of each a number of its own, the place of the newest
        /// sample, the times of all (s), and their values. Only of those with `nsample`.
        pub history: Vec<L> = sizes.nhistory,
        /// Where springs rest that yield: m or rad, quaternions (w, x, y, z) of balls; the two lengths of tendons.
        pub plastic: Vec<L> = sizes.nplastic,
        /// Controls; kept from step to step.
        pub ctrl: Vec<L> = sizes.nu,
        /// Where the solver starts: qacc - qacc_smooth of the last step, m/s^2, rad/s^2.
        pub qacc_warmstart: Vec<L> = sizes.nv,
        /// Whether each equality constraint is active, 1 or 0.
        pub eq_active: Vec<L> = sizes.neq,
        /// Positions of mocap bodies, m, world axes.
        pub mocap_pos: Vec<[L; 3]> = sizes.nmocap,
        /// Orientations of mocap bodies, quaternions (w, x, y, z) of any positive length.
        pub mocap_quat: Vec<[L; 4]> = sizes.nmocap,
        /// Steps for which each tree has rested, at most 10; from 11 on it sleeps, with 11 more than the number of the next tree of those
        /// that sleep together. MuJoCo's `tree_asleep` is 11 less. Only of models with the flag `sleep`.
        pub tree_rest: Vec<L> = sizes.nsleep,
        /// What the guard has booked of each tree that it guards: energy, work since then, largest energy (J); momentum and angular momentum
        /// about the centre of mass, world axes, and impulses since then (angular first; N m s, N s). All 0: it starts anew from the next
        /// velocities. Only of models with the option `guard`.
        pub tree_guard: Vec<[L; 15]> = sizes.nguard,
        /// What time, then positions, then histories have beyond the digits of single precision (see [`low`](crate::math::low)). Read and set
        /// with them.
        pub low: Vec<L> = sizes.nlow,
    } L
}

impl<L> State<L> {
    /// Positions and their low words, of which double precision has none.
    pub fn positions(&self) -> [&[L]; 2] {
        [&self.qpos, self.low.get(1..).unwrap_or(&[])]
    }

    /// Histories and their low words, likewise.
    pub fn past(&self) -> [&[L]; 2] {
        [&self.history, self.low.get(1 + self.qpos.len()..).unwrap_or(&[])]
    }

    /// The same, to be changed.
    pub fn past_mut(&mut self) -> [&mut [L]; 2] {
        let first = 1 + self.qpos.len();
        [&mut self.history, self.low.get_mut(first..).unwrap_or(&mut [])]
    }
}

impl<L: Lane> State<L> {
    /// The reference configuration of a model, at rest.
    pub fn initial(model: &Model<L::Real>) -> Self {
        let mut state = State::new(&model.sizes);
        let State { qpos, history, plastic, eq_active, tree_rest, low, .. } = &mut state;
        let starts: [(&mut [L], &[L::Real]); 6] = [
            (qpos, &model.qpos0),
            (history, &model.history0),
            (plastic, &model.plastic0),
            (eq_active, &model.eq_active0),
            (tree_rest, &model.tree_rest0),
            (low, &model.low0),
        ];
        for (lanes, start) in starts {
            lanes.iter_mut().zip(start).for_each(|(x, start)| *x = L::splat(*start));
        }
        let poses = state.mocap_pos.iter_mut().zip(&mut state.mocap_quat);
        for (link, (pos, quat)) in model.links.iter().filter(|link| link.mocap != NONE).zip(poses) {
            (*pos, *quat) = (link.pos.map(L::splat), link.quat.map(L::splat));
        }
        state
    }
}

impl<L: Copy> State<L> {
    /// Becomes what another state of the model is.
    pub fn copy_from(&mut self, other: &State<L>) {
        // By names, so that a new field is not forgotten.
        let State {
            time,
            qpos,
            qvel,
            act,
            history,
            plastic,
            ctrl,
            eq_active,
            qacc_warmstart,
            mocap_pos,
            mocap_quat,
            tree_rest,
            tree_guard,
            low,
        } = self;
        time.copy_from_slice(&other.time);
        qpos.copy_from_slice(&other.qpos);
        qvel.copy_from_slice(&other.qvel);
        act.copy_from_slice(&other.act);
        history.copy_from_slice(&other.history);
        plastic.copy_from_slice(&other.plastic);
        ctrl.copy_from_slice(&other.ctrl);
        eq_active.copy_from_slice(&other.eq_active);
        qacc_warmstart.copy_from_slice(&other.qacc_warmstart);
        mocap_pos.copy_from_slice(&other.mocap_pos);
        mocap_quat.copy_from_slice(&other.mocap_quat);
        tree_rest.copy_from_slice(&other.tree_rest);
        tree_guard.copy_from_slice(&other.tree_guard);
        low.copy_from_slice(&other.low);
    }
}

fields! {
    /// Forces from outside, allocated when they are first set.
    pub struct Applied(sizes) {
        /// Generalised forces from outside; N, N m.
        pub qfrc_applied: Vec<L> = sizes.nv,
        /// Force (N) and torque (N m) on each body from outside, at its centre of mass, world axes.
        pub xfrc_applied: Vec<[L; 6]> = sizes.nbody,
    } L
}

/// What happened to a world: bits that stay set until it is reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Status(pub u32);

impl Status {
    /// A position or an activation from outside was NaN or infinite.
    pub const NON_FINITE_POS: Status = Status(1 << 0);
    /// A velocity from outside was NaN or infinite.
    pub const NON_FINITE_VEL: Status = Status(1 << 1);
    /// The smooth acceleration, or a force from outside, was NaN or infinite.
    pub const NON_FINITE_ACC: Status = Status(1 << 2);
    /// A position, a velocity, an activation, a force from outside or an acceleration exceeded the largest magnitude; numbers so large may overflow
    /// to NaN in the solver.
    pub const HUGE_VALUE: Status = Status(1 << 3);
    /// A control was NaN or infinite: all controls of that step were 0.
    pub const BAD_CTRL: Status = Status(1 << 4);
    /// A quaternion of length zero in the state: it counts as the identity.
    pub const QUAT_ZERO: Status = Status(1 << 5);
    /// A quaternion in the state whose length was off by more than 1e-3; its direction counts.
    pub const QUAT_FAR: Status = Status(1 << 6);
    /// The inertia matrix had a pivot near zero.
    pub const SINGULAR_INERTIA: Status = Status(1 << 7);
    /// The guard took more than a hundredth of a tree's inner velocities in a step.
    pub const GUARDED: Status = Status(1 << 8);
    /// More contacts than the capacity.
    pub const CONTACT_OVERFLOW: Status = Status(1 << 9);
    /// The solver reached its limit of iterations.
    pub const NOT_CONVERGED: Status = Status(1 << 10);
    /// Code that the step called failed: the world, and those that shared its block, are frozen.
    pub const CALLBACK_FAILED: Status = Status(1 << 14);
    /// The world is frozen: its state is the last good one, and it is stepped no more.
    pub const FROZEN: Status = Status(1 << 15);

    /// Names of the bits, lowest first.
    pub const NAMES: [(Status, &'static str); 13] = [
        (Status::NON_FINITE_POS, "NonFinitePos"),
        (Status::NON_FINITE_VEL, "NonFiniteVel"),
        (Status::NON_FINITE_ACC, "NonFiniteAcc"),
        (Status::HUGE_VALUE, "HugeValue"),
        (Status::BAD_CTRL, "BadCtrl"),
        (Status::QUAT_ZERO, "QuatZero"),
        (Status::QUAT_FAR, "QuatFar"),
        (Status::SINGULAR_INERTIA, "SingularInertia"),
        (Status::GUARDED, "Guarded"),
        (Status::CONTACT_OVERFLOW, "ContactOverflow"),
        (Status::NOT_CONVERGED, "NotConverged"),
        (Status::CALLBACK_FAILED, "CallbackFailed"),
        (Status::FROZEN, "Frozen"),
    ];

    /// Whether this is one of the bits that come with [`FROZEN`](Status::FROZEN), as its cause.
    pub fn freezes(self) -> bool {
        matches!(
            self,
            Status::NON_FINITE_POS
                | Status::NON_FINITE_VEL
                | Status::NON_FINITE_ACC
                | Status::HUGE_VALUE
                | Status::CALLBACK_FAILED
        )
    }

    /// Whether all bits of `other` are set.
    pub fn contains(self, other: Status) -> bool {
        self.0 & other.0 == other.0
    }

    /// Sets the bits of `other`.
    pub fn insert(&mut self, other: Status) {
        self.0 |= other.0;
    }

    /// Clears the bits of `other`.
    pub fn remove(&mut self, other: Status) {
        self.0 &= !other.0;
    }

    /// Names of the bits that are set.
    pub fn names(self) -> Vec<&'static str> {
        Self::NAMES.iter().filter(|(bit, _)| self.contains(*bit)).map(|(_, name)| *name).collect()
    }
}

/// Status bits of a block, as lane masks kept as bit sets: bit `i` of an entry is lane `i`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockStatus {
    /// Lanes that go on.
    pub alive: u32,
    /// For each entry of [`Status::NAMES`], lanes in which the event happened.
    pub events: [u32; Status::NAMES.len()],
}

impl BlockStatus {
    /// Records `status` for the given lanes.
    pub fn record(&mut self, status: Status, lanes: u32) {
        for (event, (bit, _)) in self.events.iter_mut().zip(Status::NAMES) {
            if status.contains(bit) {
                *event |= lanes;
            }
        }
    }

    /// The lanes in which all of `status` happened.
    pub fn lanes(&self, status: Status) -> u32 {
        let events = self.events.iter().zip(Status::NAMES).filter(|(_, (bit, _))| status.contains(*bit));
        events.fold(u32::MAX, |lanes, (event, _)| lanes & event)
    }

    /// The status of one lane.
    pub fn lane(&self, lane: usize) -> Status {
        let mut status = Status::default();
        for (event, (bit, _)) in self.events.iter().zip(Status::NAMES) {
            if event >> lane & 1 != 0 {
                status.insert(bit);
            }
        }
        status
    }

    /// Sets one lane's status.
    pub fn set_lane(&mut self, lane: usize, status: Status) {
        for (event, (bit, _)) in self.events.iter_mut().zip(Status::NAMES) {
            *event = *event & !(1 << lane) | u32::from(status.contains(bit)) << lane;
        }
        let frozen = status.contains(Status::FROZEN);
        self.alive = self.alive & !(1 << lane) | u32::from(!frozen) << lane;
    }
}

/// Copies the state of lane `from` to lane `to`: padding lanes replicate a real world.
pub fn copy_lane<L: crate::lane::LaneQuery>(state: &mut State<L>, from: usize, to: usize) {
    state.for_each(&mut |field| {
        for lanes in field.data {
            let x = lanes.get(from);
            lanes.set(to, x);
        }
    });
}

/// The number of lanes of state that a block keeps.
pub fn state_len<L: Lane>(sizes: &crate::model::Sizes) -> usize {
    State::<L>::FIELDS.iter().map(|field| field.len(sizes)).sum()
}
