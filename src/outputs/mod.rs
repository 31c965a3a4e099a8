//! Outputs: what a run can return, by MuJoCo's names.

mod contacts;
mod frames;

use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::Model as KernelModel;
use lanesim_kernels::stage::Stage;
use lanesim_kernels::workspace::Workspace;

use self::frames::Poses;
use crate::block::Block;
use crate::error::Error;
use crate::model::Model;
use crate::rows::Rows;
use crate::suggest;
use crate::worlds::Field;

/// A world's stages, for outputs.
pub(crate) struct View<'a, L: LaneQuery> {
    pub model: &'a Model,
    pub tables: &'a KernelModel<L::Real>,
    pub block: &'a Block<L>,
    pub workspace: &'a Workspace<L>,
    /// The worlds of which the workspace holds what follows from their state, as bits: not those that are frozen.
    pub valid: u32,
    /// Those of them whose constraints were solved: not those whose smooth acceleration is too large for it.
    pub solved: u32,
}

/// What outputs are made in, kept from world to world.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    row: Vec<f64>,
    poses: Poses,
}

/// What an output is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    State(Field),
    FullPhysics,
    Status,
    Xpos,
    Xquat,
    Xmat,
    Xipos,
    Ximat,
    SubtreeCom,
    GeomXpos,
    GeomXquat,
    GeomXmat,
    SiteXpos,
    SiteXquat,
    SiteXmat,
    Xanchor,
    Xaxis,
    Cdof,
    Xvel,
    ActuatorLength,
    ActuatorVelocity,
    ActuatorForce,
    QfrcActuator,
    QM,
    QfrcBias,
    QfrcPassive,
    QfrcGravcomp,
    QfrcSmooth,
    QaccSmooth,
    QfrcConstraint,
    Qacc,
    Energy,
    SolverNiter,
    SolverResidual,
    Ncon,
    Nefc,
    ContactGeom,
    ContactDim,
    ContactDist,
    ContactPos,
    ContactFrame,
    ContactFriction,
    ContactMargin,
    ContactEfc,
    EfcType,
    EfcId,
    EfcJ,
    EfcPos,
    EfcMargin,
    EfcD,
    EfcR,
    EfcAref,
    EfcForce,
}

/// Names, and one line each of what they are.
const TABLE: [(&str, Kind, &str); 62] = [
    ("time", Kind::State(Field::Time), "time, s"),
    ("qpos", Kind::State(Field::Qpos), "positions"),
    ("qvel", Kind::State(Field::Qvel), "velocities"),
    ("act", Kind::State(Field::Act), "activations"),
    ("ctrl", Kind::State(Field::Ctrl), "controls"),
    ("qacc_warmstart", Kind::State(Field::QaccWarmstart), "start of the solver: qacc - qacc_smooth of the last step"),
    ("eq_active", Kind::State(Field::EqActive), "whether each equality constraint is active, 1 or 0"),
    ("qfrc_applied", Kind::State(Field::QfrcApplied), "generalised forces from outside"),
    ("xfrc_applied", Kind::State(Field::XfrcApplied), "forces and torques on bodies from outside"),
    ("state", Kind::FullPhysics, "time, qpos, qvel and act in one row"),
    ("status", Kind::Status, "status bits"),
    ("xpos", Kind::Xpos, "positions of body frames, m"),
    ("xquat", Kind::Xquat, "orientations of body frames"),
    ("xmat", Kind::Xmat, "the same as matrices"),
    ("xipos", Kind::Xipos, "centres of mass of bodies, m"),
    ("ximat", Kind::Ximat, "orientations of bodies' inertial frames"),
    ("subtree_com", Kind::SubtreeCom, "centre of mass of each body and its descendants, m"),
    ("geom_xpos", Kind::GeomXpos, "positions of geoms, m"),
    ("geom_xquat", Kind::GeomXquat, "orientations of geoms"),
    ("geom_xmat", Kind::GeomXmat, "the same as matrices"),
    ("site_xpos", Kind::SiteXpos, "positions of sites, m"),
    ("site_xquat", Kind::SiteXquat, "orientations of sites"),
    ("site_xmat", Kind::SiteXmat, "the same as matrices"),
    ("xanchor", Kind::Xanchor, "anchors of joints, m"),
    ("xaxis", Kind::Xaxis, "axes of joints"),
    ("cdof", Kind::Cdof, "motion of each dof (angular, linear) at its tree's centre of mass"),
    ("xvel", Kind::Xvel, "velocities of body frames (angular, linear)"),
    ("actuator_length", Kind::ActuatorLength, "actuator lengths"),
    ("actuator_velocity", Kind::ActuatorVelocity, "actuator velocities"),
    ("actuator_force", Kind::ActuatorForce, "actuator forces"),
    ("qfrc_actuator", Kind::QfrcActuator, "generalised force of actuators"),
    ("qM", Kind::QM, "inertia matrix, dense"),
    ("M", Kind::QM, "inertia matrix, dense"),
    ("qfrc_bias", Kind::QfrcBias, "Coriolis, centrifugal and gravity forces"),
    ("qfrc_passive", Kind::QfrcPassive, "passive forces"),
    ("qfrc_gravcomp", Kind::QfrcGravcomp, "gravity compensation"),
    ("qfrc_smooth", Kind::QfrcSmooth, "all forces but the constraints'"),
    ("qacc_smooth", Kind::QaccSmooth, "acceleration without constraints"),
    ("qfrc_constraint", Kind::QfrcConstraint, "generalised force of constraints"),
    ("qacc", Kind::Qacc, "acceleration"),
    ("energy", Kind::Energy, "potential and kinetic energy, J"),
    ("solver_niter", Kind::SolverNiter, "solver iterations"),
    ("solver_residual", Kind::SolverResidual, "gradient of the solver's cost at qacc, over mean inertia and nv"),
    ("ncon", Kind::Ncon, "number of contacts"),
    ("nefc", Kind::Nefc, "number of constraint rows"),
    ("contact_geom", Kind::ContactGeom, "geoms of contacts"),
    ("contact_dim", Kind::ContactDim, "dimensions of contacts"),
    ("contact_dist", Kind::ContactDist, "distances of contacts, m"),
    ("contact_pos", Kind::ContactPos, "positions of contacts, m"),
    ("contact_frame", Kind::ContactFrame, "frames of contacts: normal and two tangents"),
    ("contact_friction", Kind::ContactFriction, "friction of contacts"),
    ("contact_margin", Kind::ContactMargin, "distance below which force acts, m"),
    ("contact_efc", Kind::ContactEfc, "first row of each contact, or -1"),
    ("efc_type", Kind::EfcType, "types of rows"),
    ("efc_id", Kind::EfcId, "equality constraint, dof, joint or contact of each row"),
    ("efc_J", Kind::EfcJ, "constraint Jacobian, dense"),
    ("efc_pos", Kind::EfcPos, "violations of rows"),
    ("efc_margin", Kind::EfcMargin, "margins of rows"),
    ("efc_D", Kind::EfcD, "1/R of rows"),
    ("efc_R", Kind::EfcR, "regularisers of rows"),
    ("efc_aref", Kind::EfcAref, "reference accelerations of rows"),
    ("efc_force", Kind::EfcForce, "forces of rows"),
];

/// Where the names of all outputs are, for who meant none that is near.
const LISTED: &str = "`lanesim rollout --help`, lanesim.OUTPUTS in Python and Output::all in Rust list them";

/// An output that was asked for.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    name: &'static str,
    kind: Kind,
}

impl Output {
    /// The output called `name`.
    pub fn named(name: &str) -> Result<Output, Error> {
        TABLE.iter().find(|row| row.0 == name).map(|row| Output { name: row.0, kind: row.1 }).ok_or_else(|| {
            if name == "sensordata" {
                return Error::Unknown("sensors are not built, so there is no output sensordata".into());
            }
            let near = suggest::did_you_mean(name, TABLE.iter().map(|row| row.0));
            let remedy = if near.is_empty() { LISTED } else { &near };
            Error::Unknown(format!("there is no output {name}; {remedy}"))
        })
    }

    /// Names and meanings of all outputs.
    pub fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
        TABLE.iter().map(|row| (row.0, row.2))
    }

    /// Name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Whether the numbers are integers.
    pub fn is_integer(&self) -> bool {
        use Kind::{ContactDim, ContactEfc, ContactGeom, EfcId, EfcType, Ncon, Nefc, SolverNiter, Status};
        matches!(
            self.kind,
            Status | SolverNiter | Ncon | Nefc | ContactGeom | ContactDim | ContactEfc | EfcType | EfcId
        )
    }

    /// The stage that computes it; `None` for the state itself.
    pub(crate) fn stage(&self) -> Option<Stage> {
        use Kind::{
            ActuatorForce, ActuatorLength, ActuatorVelocity, Cdof, ContactDim, ContactDist, ContactFrame,
            ContactFriction, ContactGeom, ContactMargin, ContactPos, EfcForce, Energy, GeomXmat, GeomXpos, GeomXquat,
            Ncon, QM, Qacc, QaccSmooth, QfrcActuator, QfrcBias, QfrcConstraint, QfrcGravcomp, QfrcPassive, QfrcSmooth,
            SiteXmat, SiteXpos, SiteXquat, SolverNiter, SolverResidual, State, Status, SubtreeCom, Ximat, Xipos, Xmat,
            Xpos, Xquat, Xvel,
        };
        Some(match self.kind {
            State(_) | Kind::FullPhysics => return None,
            Xpos
            | Xquat
            | Xmat
            | Xipos
            | Ximat
            | SubtreeCom
            | GeomXpos
            | GeomXquat
            | GeomXmat
            | SiteXpos
            | SiteXquat
            | SiteXmat
            | Kind::Xanchor
            | Kind::Xaxis
            | Cdof => Stage::Position,
            QM => Stage::Inertia,
            Ncon | ContactGeom | ContactDim | ContactDist | ContactPos | ContactFrame | ContactFriction
            | ContactMargin => Stage::Collision,
            Xvel | QfrcBias => Stage::Velocity,
            Energy => Stage::Energy,
            Kind::Nefc
            | Kind::ContactEfc
            | Kind::EfcType
            | Kind::EfcId
            | Kind::EfcJ
            | Kind::EfcPos
            | Kind::EfcMargin
            | Kind::EfcD
            | Kind::EfcR
            | Kind::EfcAref => Stage::Constraint,
            QfrcPassive | QfrcGravcomp => Stage::Passive,
            ActuatorLength | ActuatorVelocity | ActuatorForce | QfrcActuator => Stage::Actuation,
            QfrcSmooth | QaccSmooth => Stage::Acceleration,
            // What a forward run flags, it flags anywhere up to the solver.
            QfrcConstraint | Qacc | SolverNiter | SolverResidual | EfcForce | Status => Stage::Solver,
        })
    }

    /// Whether it follows from the state that a step starts from; the state itself and the status are what the step leaves.
    pub(crate) fn derived(&self) -> bool {
        self.stage().is_some() && self.kind != Kind::Status
    }

    /// Whether it needs the solver's residual.
    pub(crate) fn needs_residual(&self) -> bool {
        self.kind == Kind::SolverResidual
    }

    /// Shape per world; `None` where the first dimension, of which this is the rest, differs between worlds.
    pub fn shape(&self, model: &Model) -> (bool, Vec<usize>) {
        let s = &model.tables().sizes;
        let fixed = |shape: &[usize]| (true, shape.to_vec());
        let ragged = |shape: &[usize]| (false, shape.to_vec());
        match self.kind {
            Kind::State(Field::XfrcApplied) => fixed(&[s.nbody, 6]),
            Kind::State(Field::Time)
            | Kind::Status
            | Kind::SolverNiter
            | Kind::SolverResidual
            | Kind::Ncon
            | Kind::Nefc => fixed(&[]),
            Kind::State(field) => fixed(&[field.len(model)]),
            Kind::FullPhysics => fixed(&[1 + s.nq + s.nv + s.na]),
            Kind::Xpos | Kind::Xipos | Kind::SubtreeCom => fixed(&[s.nbody, 3]),
            Kind::Xquat => fixed(&[s.nbody, 4]),
            Kind::Xmat | Kind::Ximat => fixed(&[s.nbody, 9]),
            Kind::GeomXpos => fixed(&[s.ngeom, 3]),
            Kind::GeomXquat => fixed(&[s.ngeom, 4]),
            Kind::GeomXmat => fixed(&[s.ngeom, 9]),
            Kind::SiteXpos => fixed(&[s.nsite, 3]),
            Kind::SiteXquat => fixed(&[s.nsite, 4]),
            Kind::SiteXmat => fixed(&[s.nsite, 9]),
            Kind::Xanchor | Kind::Xaxis => fixed(&[s.njnt, 3]),
            Kind::Cdof => fixed(&[s.nv, 6]),
            Kind::Xvel => fixed(&[s.nbody, 6]),
            Kind::ActuatorLength | Kind::ActuatorVelocity | Kind::ActuatorForce => fixed(&[s.nu]),
            Kind::QM => fixed(&[s.nv, s.nv]),
            Kind::QfrcActuator
            | Kind::QfrcBias
            | Kind::QfrcPassive
            | Kind::QfrcGravcomp
            | Kind::QfrcSmooth
            | Kind::QaccSmooth
            | Kind::QfrcConstraint
            | Kind::Qacc => fixed(&[s.nv]),
            Kind::Energy => fixed(&[2]),
            Kind::ContactGeom => ragged(&[2]),
            Kind::ContactPos => ragged(&[3]),
            Kind::ContactFrame => ragged(&[9]),
            Kind::ContactFriction => ragged(&[5]),
            Kind::EfcJ => ragged(&[s.nv]),
            Kind::ContactDim
            | Kind::ContactDist
            | Kind::ContactMargin
            | Kind::ContactEfc
            | Kind::EfcType
            | Kind::EfcId
            | Kind::EfcPos
            | Kind::EfcMargin
            | Kind::EfcD
            | Kind::EfcR
            | Kind::EfcAref
            | Kind::EfcForce => ragged(&[]),
        }
    }

    /// Numbers per world, if all worlds have the same number.
    pub fn width(&self, model: &Model) -> Option<usize> {
        let (fixed, shape) = self.shape(model);
        fixed.then(|| shape.iter().product())
    }

    /// Writes a world's numbers to `out`, from entry `at` on. Allocates nothing once the buffers have grown.
    pub(crate) fn write<L: LaneQuery>(
        &self,
        view: &View<'_, L>,
        lane: usize,
        buffers: &mut Buffers,
        out: &mut Rows<'_>,
        at: usize,
    ) {
        let Buffers { row, poses } = buffers;
        row.clear();
        let known = match self.stage() {
            None => !0,
            Some(_) if self.kind == Kind::Status => !0,
            Some(Stage::Solver) => view.solved,
            Some(_) => view.valid,
        };
        if known >> lane & 1 == 0 {
            self.leave_out(view.model, row);
        } else {
            self.extend(view, lane, poses, row);
        }
        out.write(at, row);
    }

    /// What stands for numbers that a world does not have, as it is frozen, or its state from outside cannot be stepped: NaN, the
    /// count 0, empty lists.
    fn leave_out(&self, model: &Model, out: &mut Vec<f64>) {
        let nothing = if self.is_integer() { 0.0 } else { f64::NAN };
        out.resize(out.len() + self.width(model).unwrap_or(0), nothing);
    }

    /// Appends a world's numbers to `out`.
    fn extend<L: LaneQuery>(&self, view: &View<'_, L>, lane: usize, poses: &mut Poses, out: &mut Vec<f64>) {
        let ws = view.workspace;
        let placements = view.model.placements();
        let (nv, nu) = (view.tables.sizes.nv, view.tables.sizes.nu);
        // A stage that the model does not have keeps no numbers: they are zero.
        let read = |lanes: &[L], n: usize, out: &mut Vec<f64>| {
            let end = out.len() + n;
            out.extend(lanes.iter().map(|x| number(x, lane)));
            out.resize(end, 0.0);
        };
        match self.kind {
            Kind::State(field) => view.block.read(field, &view.tables.sizes, lane, out),
            Kind::FullPhysics => {
                for field in Field::STATE {
                    view.block.read(field, &view.tables.sizes, lane, out);
                }
            }
            Kind::Status => out.push(f64::from(view.block.status.lane(lane).0)),
            Kind::Xpos => frames::positions(view, lane, &placements.bodies, out),
            Kind::Xquat => frames::quaternions(view, lane, &placements.bodies, poses, out),
            Kind::Xmat => frames::matrices(view, lane, &placements.bodies, out),
            Kind::Xipos => frames::positions(view, lane, &placements.inertials, out),
            Kind::Ximat => frames::matrices(view, lane, &placements.inertials, out),
            Kind::SubtreeCom => out.extend(frames::subtree_com(view, lane, poses).iter().flat_map(|x| x.to_array())),
            Kind::GeomXpos => frames::positions(view, lane, &placements.geoms, out),
            Kind::GeomXquat => frames::quaternions(view, lane, &placements.geoms, poses, out),
            Kind::GeomXmat => frames::matrices(view, lane, &placements.geoms, out),
            Kind::SiteXpos => frames::positions(view, lane, &placements.sites, out),
            Kind::SiteXquat => frames::quaternions(view, lane, &placements.sites, poses, out),
            Kind::SiteXmat => frames::matrices(view, lane, &placements.sites, out),
            Kind::Xanchor => frames::anchors(view, lane, out),
            Kind::Xaxis => frames::axes(view, lane, out),
            Kind::Cdof => frames::cdof(view, lane, poses, out),
            Kind::Xvel => frames::velocities(view, lane, out),
            Kind::ActuatorLength => read(&ws.actuation.length, nu, out),
            Kind::ActuatorVelocity => read(&ws.actuation.velocity, nu, out),
            Kind::ActuatorForce => read(&ws.actuation.force, nu, out),
            Kind::QfrcActuator => read(&ws.actuation.qfrc_actuator, nv, out),
            Kind::QM => dense_inertia(view, lane, out),
            Kind::QfrcBias => read(&ws.velocity.qfrc_bias, nv, out),
            Kind::QfrcPassive => read(&ws.passive.qfrc_passive, nv, out),
            Kind::QfrcGravcomp => read(&ws.passive.qfrc_gravcomp, nv, out),
            Kind::QfrcSmooth => read(&ws.acceleration.qfrc_smooth, nv, out),
            Kind::QaccSmooth => read(&ws.acceleration.qacc_smooth, nv, out),
            Kind::QfrcConstraint => read(&ws.solver.fields.qfrc_constraint, nv, out),
            Kind::Qacc => read(&ws.solver.fields.qacc, nv, out),
            Kind::Energy => out.extend([&ws.energy.potential[0], &ws.energy.kinetic[0]].map(|x| number(x, lane))),
            Kind::SolverNiter => out.push(number(&ws.solver.statistics.niter, lane)),
            Kind::SolverResidual => out.push(number(&ws.solver.statistics.residual, lane)),
            Kind::Ncon => out.push(contacts::count(view, lane) as f64),
            Kind::Nefc => out.push(contacts::count_rows(view, lane) as f64),
            _ => out.extend(contacts::values(self.kind, view, lane)),
        }
    }
}

/// A lane's entry, widened; a zero of either sign is +0.
fn number<L: LaneQuery>(x: &L, lane: usize) -> f64 {
    x.get(lane).to_f64() + 0.0
}

/// Appends the inertia matrix as nv × nv numbers.
fn dense_inertia<L: LaneQuery>(view: &View<'_, L>, lane: usize, out: &mut Vec<f64>) {
    let nv = view.tables.sizes.nv;
    let start = out.len();
    out.resize(start + nv * nv, 0.0);
    let out = &mut out[start..];
    for i in 0..nv {
        let columns = view.tables.tree_pattern.row(i).iter().flat_map(|run| run.range()).chain([i]);
        for j in columns {
            let x = number(&view.workspace.inertia.m[view.tables.rows.at(i, j)], lane);
            out[i * nv + j] = x;
            out[j * nv + i] = x;
        }
    }
}
