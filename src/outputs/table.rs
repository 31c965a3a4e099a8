//! All outputs: of each its name, what it is, its unit, its shape, the stage that computes it, and how it is written.

use lanesim_kernels::lane::LaneQuery;
use lanesim_kernels::model::Sizes;
use lanesim_kernels::stage::Stage;

use super::World;
use super::contacts::{self, of_contacts, of_rows};
use super::forces;
use super::frames::{self, Poses};
use crate::field::Field;

/// Writes a world's numbers.
pub(super) type Write<L> = fn(World<'_, L>, &mut Poses, &mut Vec<f64>);

/// Where an output comes from.
pub(super) enum Read<L: LaneQuery> {
    /// Fields of the state, one after the other.
    State(&'static [Field]),
    /// The world's status.
    Status,
    /// What a stage leaves.
    Stage(Stage, Write<L>),
}

impl<L: LaneQuery> Clone for Read<L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: LaneQuery> Copy for Read<L> {}

/// One dimension of a world's numbers.
#[derive(Clone, Copy, Debug)]
pub(super) enum Dim {
    /// As many as the model has of something: how that is called, and the count.
    Of(&'static str, fn(&Sizes) -> usize),
    /// The same for all models.
    Always(usize),
}

impl Dim {
    pub fn count(self, sizes: &Sizes) -> usize {
        match self {
            Dim::Of(_, count) => count(sizes),
            Dim::Always(n) => n,
        }
    }

    fn name(self) -> String {
        match self {
            Dim::Of(name, _) => name.to_owned(),
            Dim::Always(n) => n.to_string(),
        }
    }
}

const NV: Dim = Dim::Of("nv", |sizes| sizes.nv);
const NTENDON: Dim = Dim::Of("ntendon", |sizes| sizes.ntendon);
const NOUT: Dim = Dim::Of("nout", |sizes| sizes.nout);
const NA: Dim = Dim::Of("na", |sizes| sizes.na);
const NBODY: Dim = Dim::Of("nbody", |sizes| sizes.nbody);
const NGEOM: Dim = Dim::Of("ngeom", |sizes| sizes.ngeom);
const NSITE: Dim = Dim::Of("nsite", |sizes| sizes.nsite);
const NSENSORDATA: Dim = Dim::Of("nsensordata", |sizes| sizes.nsensordata);
const NJNT: Dim = Dim::Of("njnt", |sizes| sizes.njnt);
const TWO: Dim = Dim::Always(2);
const THREE: Dim = Dim::Always(3);
const FOUR: Dim = Dim::Always(4);
const FIVE: Dim = Dim::Always(5);
const SIX: Dim = Dim::Always(6);
const NINE: Dim = Dim::Always(9);

/// What a shape is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rest {
    /// A world.
    World,
    /// Each contact of a world.
    Contact,
    /// Each constraint row of a world.
    Row,
}

/// An output.
pub(super) struct Entry<L: LaneQuery> {
    pub name: &'static str,
    /// What it is; of a field of the state, the field's declaration says it.
    what: &'static str,
    unit: &'static str,
    pub rest: Rest,
    pub shape: &'static [Dim],
    pub integer: bool,
    /// Whether it needs the solver's residual.
    pub residual: bool,
    pub read: Read<L>,
}

impl<L: LaneQuery> Entry<L> {
    const fn new(name: &'static str, what: &'static str, unit: &'static str, read: Read<L>) -> Self {
        Entry { name, what, unit, rest: Rest::World, shape: &[], integer: false, residual: false, read }
    }

    const fn of(
        name: &'static str,
        shape: &'static [Dim],
        (what, unit): (&'static str, &'static str),
        stage: Stage,
        write: Write<L>,
    ) -> Self {
        Entry { shape, ..Self::new(name, what, unit, Read::Stage(stage, write)) }
    }

    const fn state(fields: &'static [Field; 1]) -> Self {
        Self::new(fields[0].name(), "", "", Read::State(fields))
    }

    const fn per(self, rest: Rest) -> Self {
        Entry { rest, ..self }
    }

    const fn integer(self) -> Self {
        Entry { integer: true, ..self }
    }

    /// Whether it is of one point.
    pub fn of_point(&self) -> bool {
        self.name.ends_with(":NAME")
    }

    /// What it is, with shape and unit.
    pub fn meaning(&self) -> String {
        if let Read::State([field]) = self.read {
            return format!("{}{}", field.meaning().trim_end_matches('.'), listed(field.dims()));
        }
        let first = match self.rest {
            Rest::World => None,
            Rest::Contact => Some("ncon".to_owned()),
            Rest::Row => Some("nefc".to_owned()),
        };
        let shape = listed(first.into_iter().chain(self.shape.iter().map(|dim| dim.name())).collect());
        let unit = if self.unit.is_empty() { String::new() } else { format!("; {}", self.unit) };
        format!("{}{shape}{unit}", self.what)
    }
}

/// Dimensions in words.
fn listed(dims: Vec<String>) -> String {
    if dims.is_empty() { String::new() } else { format!(" [{}]", dims.join(", ")) }
}

/// Of dofs and what acts on them.
const FORCE: &str = "N, N m";
const ACCELERATION: &str = "m/s^2, rad/s^2";

/// The outputs, for a kind of lanes.
pub(super) struct Table<L>(std::marker::PhantomData<L>);

impl<L: LaneQuery> Table<L> {
    /// All of them.
    pub const ENTRIES: &'static [Entry<L>] = &[
        Entry::state(&[Field::Time]),
        Entry::state(&[Field::Qpos]),
        Entry::state(&[Field::Qvel]),
        Entry::state(&[Field::Act]),
        Entry::state(&[Field::History]),
        Entry::state(&[Field::Plastic]),
        Entry::state(&[Field::Ctrl]),
        Entry::state(&[Field::QaccWarmstart]),
        Entry::state(&[Field::EqActive]),
        Entry::state(&[Field::MocapPos]),
        Entry::state(&[Field::MocapQuat]),
        Entry::state(&[Field::TreeRest]),
        Entry::state(&[Field::TreeGuard]),
        Entry::state(&[Field::QfrcApplied]),
        Entry::state(&[Field::XfrcApplied]),
        Entry::new("state", "time, qpos, qvel, act, history and plastic in one row", "", Read::State(&Field::STATE)),
        Entry::new("status", "status bits", "", Read::Status).integer(),
        Entry::of("xpos", &[NBODY, THREE], ("positions of body frames", "m"), Stage::Position, |w, _, out| {
            frames::positions(w, &w.model.placements().bodies, out);
        }),
        Entry::of("xquat", &[NBODY, FOUR], ("orientations of body frames", ""), Stage::Position, |w, poses, out| {
            frames::quaternions(w, &w.model.placements().bodies, poses, out);
        }),
        Entry::of("xmat", &[NBODY, NINE], ("the same as matrices", ""), Stage::Position, |w, _, out| {
            frames::matrices(w, &w.model.placements().bodies, out);
        }),
        Entry::of("xipos", &[NBODY, THREE], ("centres of mass of bodies", "m"), Stage::Position, |w, _, out| {
            frames::positions(w, &w.model.placements().inertials, out);
        }),
        Entry::of(
            "ximat",
            &[NBODY, NINE],
            ("orientations of bodies' inertial frames", ""),
            Stage::Position,
            |w, _, out| frames::matrices(w, &w.model.placements().inertials, out),
        ),
        Entry::of(
            "subtree_com",
            &[NBODY, THREE],
            ("centre of mass of each body and its descendants", "m"),
            Stage::Position,
            |w, poses, out| out.extend(frames::subtree_com(w, poses).iter().flat_map(|x| x.to_array())),
        ),
        Entry::of("geom_xpos", &[NGEOM, THREE], ("positions of geoms", "m"), Stage::Position, |w, _, out| {
            frames::positions(w, &w.model.placements().geoms, out);
        }),
        Entry::of("geom_xquat", &[NGEOM, FOUR], ("orientations of geoms", ""), Stage::Position, |w, poses, out| {
            frames::quaternions(w, &w.model.placements().geoms, poses, out);
        }),
        Entry::of("geom_xmat", &[NGEOM, NINE], ("the same as matrices", ""), Stage::Position, |w, _, out| {
            frames::matrices(w, &w.model.placements().geoms, out);
        }),
        Entry::of("site_xpos", &[NSITE, THREE], ("positions of sites", "m"), Stage::Position, |w, _, out| {
            frames::positions(w, &w.model.placements().sites, out);
        }),
        Entry::of("site_xquat", &[NSITE, FOUR], ("orientations of sites", ""), Stage::Position, |w, poses, out| {
            frames::quaternions(w, &w.model.placements().sites, poses, out);
        }),
        Entry::of("site_xmat", &[NSITE, NINE], ("the same as matrices", ""), Stage::Position, |w, _, out| {
            frames::matrices(w, &w.model.placements().sites, out);
        }),
        Entry::of("xanchor", &[NJNT, THREE], ("anchors of joints", "m"), Stage::Position, |w, _, out| {
            frames::anchors(w, out);
        }),
        Entry::of("xaxis", &[NJNT, THREE], ("axes of joints", ""), Stage::Position, |w, _, out| frames::axes(w, out)),
        Entry::of(
            "cdof",
            &[NV, SIX],
            ("motion of each dof (angular, linear) at its tree's centre of mass", ""),
            Stage::Position,
            frames::cdof,
        ),
        Entry::of(
            "jac_body:NAME",
            &[SIX, NV],
            ("Jacobian of a body's frame (three rows linear, three angular), by the body's name or number", ""),
            Stage::Position,
            frames::jacobian,
        ),
        Entry::of("jac_geom:NAME", &[SIX, NV], ("the same of a geom's middle", ""), Stage::Position, frames::jacobian),
        Entry::of("jac_site:NAME", &[SIX, NV], ("the same of a site", ""), Stage::Position, frames::jacobian),
        Entry::of(
            "cvel",
            &[NBODY, SIX],
            ("velocities of bodies (angular, linear) at their tree's centre of mass", "rad/s, m/s"),
            Stage::Velocity,
            frames::com_velocities,
        ),
        Entry::of(
            "xvel",
            &[NBODY, SIX],
            ("velocities of body frames (angular, linear)", "rad/s, m/s"),
            Stage::Velocity,
            |w, _, out| frames::velocities(w, out),
        ),
        Entry::of(
            "subtree_linvel",
            &[NBODY, THREE],
            ("velocity of the centre of mass of each body and its descendants", "m/s"),
            Stage::Velocity,
            frames::subtree_linvel,
        ),
        Entry::of(
            "cacc",
            &[NBODY, SIX],
            ("accelerations of bodies like cvel, that of gravity upwards in them", "rad/s^2, m/s^2"),
            Stage::Solver,
            forces::accelerations,
        ),
        Entry::of(
            "cfrc_ext",
            &[NBODY, SIX],
            (
                "forces (torque, force) on bodies from xfrc_applied, contacts, connects and welds, at their tree's centre of mass",
                "N m, N",
            ),
            Stage::Solver,
            forces::external,
        ),
        Entry::of(
            "cfrc_int",
            &[NBODY, SIX],
            ("forces (torque, force) with which parents act on bodies, likewise", "N m, N"),
            Stage::Solver,
            forces::internal,
        ),
        Entry::of("ten_length", &[NTENDON], ("lengths of tendons", "m"), Stage::Tendon, |w, _, out| {
            w.numbers(&w.workspace.tendons.length, w.tables.sizes.ntendon, out);
        }),
        Entry::of(
            "ten_velocity",
            &[NTENDON],
            ("rates of the lengths of tendons", "m/s"),
            Stage::Tendon,
            |w, _, out| {
                w.numbers(&w.workspace.tendons.velocity, w.tables.sizes.ntendon, out);
            },
        ),
        Entry::of(
            "ten_J",
            &[NTENDON, NV],
            ("Jacobian of the lengths of tendons", ""),
            Stage::Tendon,
            frames::tendon_jacobians,
        ),
        Entry::of("actuator_length", &[NOUT], ("actuator lengths", ""), Stage::Actuation, |w, _, out| {
            w.numbers(&w.workspace.actuation.length, w.tables.sizes.nout, out);
        }),
        Entry::of("actuator_velocity", &[NOUT], ("actuator velocities", ""), Stage::Actuation, |w, _, out| {
            w.numbers(&w.workspace.actuation.velocity, w.tables.sizes.nout, out);
        }),
        Entry::of("actuator_force", &[NOUT], ("actuator forces", ""), Stage::Actuation, |w, _, out| {
            w.numbers(&w.workspace.actuation.force, w.tables.sizes.nout, out);
        }),
        Entry::of("act_dot", &[NA], ("rates of activations", "1/s"), Stage::Actuation, |w, _, out| {
            w.numbers(&w.workspace.actuation.act_dot, w.tables.sizes.na, out);
        }),
        Entry::of(
            "actuator_moment",
            &[NOUT, NV],
            ("generalised force per unit of force of each actuator", ""),
            Stage::Actuation,
            forces::moments,
        ),
        Entry::of("qfrc_actuator", &[NV], ("generalised force of actuators", FORCE), Stage::Actuation, |w, _, out| {
            w.numbers(&w.workspace.actuation.qfrc_actuator, w.tables.sizes.nv, out)
        }),
        Entry::of("qM", &[NV, NV], ("inertia matrix", ""), Stage::Inertia, |w, _, out| forces::inertia(w, out)),
        Entry::of("M", &[NV, NV], ("inertia matrix", ""), Stage::Inertia, |w, _, out| forces::inertia(w, out)),
        Entry::of(
            "qfrc_bias",
            &[NV],
            ("Coriolis, centrifugal and gravity forces", FORCE),
            Stage::Velocity,
            |w, _, out| w.numbers(&w.workspace.velocity.qfrc_bias, w.tables.sizes.nv, out),
        ),
        Entry::of("qfrc_passive", &[NV], ("passive forces", FORCE), Stage::Passive, |w, _, out| {
            w.numbers(&w.workspace.passive.qfrc_passive, w.tables.sizes.nv, out);
        }),
        Entry::of("qfrc_gravcomp", &[NV], ("gravity compensation", FORCE), Stage::Passive, |w, _, out| {
            w.numbers(&w.workspace.passive.qfrc_gravcomp, w.tables.sizes.nv, out);
        }),
        Entry::of(
            "qfrc_smooth",
            &[NV],
            ("all forces but the constraints'", FORCE),
            Stage::Acceleration,
            forces::smooth,
        ),
        Entry::of(
            "qacc_smooth",
            &[NV],
            ("acceleration without constraints", ACCELERATION),
            Stage::Acceleration,
            |w, _, out| w.numbers(&w.workspace.acceleration.qacc_smooth, w.tables.sizes.nv, out),
        ),
        Entry::of("qfrc_constraint", &[NV], ("generalised force of constraints", FORCE), Stage::Solver, |w, _, out| {
            w.numbers(&w.workspace.solver.fields.qfrc_constraint, w.tables.sizes.nv, out)
        }),
        Entry::of("qacc", &[NV], ("acceleration", ACCELERATION), Stage::Solver, |w, _, out| {
            w.numbers(&w.workspace.solver.fields.qacc, w.tables.sizes.nv, out);
        }),
        Entry::of(
            "qfrc_inverse",
            &[NV],
            ("force that qacc takes from actuators and from outside: M qacc less all other forces", FORCE),
            Stage::Solver,
            forces::inverse,
        ),
        Entry::of("sensordata", &[NSENSORDATA], ("measures of sensors", ""), Stage::Sensor, |w, _, out| {
            w.numbers(&w.workspace.sensors.data, w.tables.sizes.nsensordata, out);
        }),
        Entry::of("energy", &[TWO], ("potential and kinetic energy", "J"), Stage::Energy, |w, _, out| {
            let energy = &w.workspace.energy;
            out.extend([&energy.potential[0], &energy.kinetic[0]].map(|x| w.number(x)));
        }),
        Entry::of("solver_niter", &[], ("solver iterations", ""), Stage::Solver, |w, _, out| {
            out.push(w.number(&w.workspace.solver.statistics.niter));
        })
        .integer(),
        Entry {
            residual: true,
            ..Entry::of(
                "solver_residual",
                &[],
                ("gradient of the solver's cost at qacc, over mean inertia and nv", ""),
                Stage::Solver,
                |w, _, out| out.push(w.number(&w.workspace.solver.statistics.residual)),
            )
        },
        Entry::of("ncon", &[], ("number of contacts", ""), Stage::Collision, |w, _, out| {
            out.push(contacts::count(w) as f64);
        })
        .integer(),
        Entry::of("nefc", &[], ("number of constraint rows", ""), Stage::Constraint, |w, _, out| {
            out.push(contacts::count_rows(w) as f64);
        })
        .integer(),
        Entry::of("contact_geom", &[TWO], ("geoms of contacts", ""), Stage::Collision, |w, _, out| {
            of_contacts(w, out, |c| contacts::geoms(w, c).map(|geom| geom as f64));
        })
        .per(Rest::Contact)
        .integer(),
        Entry::of("contact_dim", &[], ("dimensions of contacts", ""), Stage::Collision, |w, _, out| {
            of_contacts(w, out, |c| [f64::from(contacts::pair(w, c).condim)]);
        })
        .per(Rest::Contact)
        .integer(),
        Entry::of("contact_dist", &[], ("distances of contacts", "m"), Stage::Collision, |w, _, out| {
            of_contacts(w, out, |c| [contacts::distance(w, c)]);
        })
        .per(Rest::Contact),
        Entry::of("contact_pos", &[THREE], ("positions of contacts", "m"), Stage::Collision, |w, _, out| {
            of_contacts(w, out, |c| contacts::position(w, c).to_array());
        })
        .per(Rest::Contact),
        Entry::of(
            "contact_frame",
            &[NINE],
            ("frames of contacts: normal and two tangents", ""),
            Stage::Collision,
            |w, _, out| of_contacts(w, out, |c| contacts::frame(w, c)),
        )
        .per(Rest::Contact),
        Entry::of("contact_friction", &[FIVE], ("friction of contacts", ""), Stage::Collision, |w, _, out| {
            of_contacts(w, out, |c| contacts::friction(w, c));
        })
        .per(Rest::Contact),
        Entry::of("contact_margin", &[], ("distance below which force acts", "m"), Stage::Collision, |w, _, out| {
            of_contacts(w, out, |c| [contacts::margin(w, c)])
        })
        .per(Rest::Contact),
        Entry::of("contact_efc", &[], ("first row of each contact, or -1", ""), Stage::Constraint, |w, _, out| {
            contacts::first_rows(w, out);
        })
        .per(Rest::Contact)
        .integer(),
        Entry::of("efc_type", &[], ("types of rows", ""), Stage::Constraint, |w, _, out| {
            of_rows(w, false, out, |row, out| out.push(f64::from(row.kind)));
        })
        .per(Rest::Row)
        .integer(),
        Entry::of(
            "efc_id",
            &[],
            ("equality constraint, dof, joint, tendon or contact of each row", ""),
            Stage::Constraint,
            |w, _, out| of_rows(w, false, out, |row, out| out.push(row.id as f64)),
        )
        .per(Rest::Row)
        .integer(),
        Entry::of("efc_J", &[NV], ("constraint Jacobian", ""), Stage::Constraint, |w, _, out| {
            of_rows(w, false, out, |row, out| out.extend(&row.jacobian));
        })
        .per(Rest::Row),
        Entry::of("efc_pos", &[], ("violations of rows", "m, rad"), Stage::Constraint, |w, _, out| {
            of_rows(w, false, out, |row, out| out.push(row.pos));
        })
        .per(Rest::Row),
        Entry::of("efc_margin", &[], ("margins of rows", "m, rad"), Stage::Constraint, |w, _, out| {
            of_rows(w, false, out, |row, out| out.push(row.margin));
        })
        .per(Rest::Row),
        Entry::of("efc_D", &[], ("1/R of rows", ""), Stage::Constraint, |w, _, out| {
            of_rows(w, false, out, |row, out| out.push(row.d));
        })
        .per(Rest::Row),
        Entry::of("efc_R", &[], ("regularisers of rows", ""), Stage::Constraint, |w, _, out| {
            of_rows(w, false, out, |row, out| out.push(1.0 / row.d));
        })
        .per(Rest::Row),
        Entry::of(
            "efc_aref",
            &[],
            ("reference accelerations of rows", ACCELERATION),
            Stage::Constraint,
            |w, _, out| of_rows(w, false, out, |row, out| out.push(row.aref)),
        )
        .per(Rest::Row),
        Entry::of("efc_force", &[], ("forces of rows", FORCE), Stage::Solver, |w, _, out| {
            of_rows(w, true, out, |row, out| out.push(row.force));
        })
        .per(Rest::Row),
    ];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_output_has_a_name_of_its_own_and_says_what_it_is() {
        let entries = Table::<f64>::ENTRIES;
        for (i, entry) in entries.iter().enumerate() {
            assert!(entries[..i].iter().all(|other| other.name != entry.name), "{}", entry.name);
            assert!(!entry.meaning().is_empty(), "{}", entry.name);
        }
        let meaning = |name: &str| entries.iter().find(|entry| entry.name == name).map(Entry::meaning);
        assert_eq!(meaning("efc_J").as_deref(), Some("constraint Jacobian [nefc, nv]"));
        assert_eq!(meaning("xpos").as_deref(), Some("positions of body frames [nbody, 3]; m"));
    }

    #[test]
    fn every_field_of_the_state_is_an_output() {
        for (field, name) in Field::ALL {
            let entry = Table::<f64>::ENTRIES.iter().find(|entry| entry.name == name);
            assert!(matches!(entry.map(|entry| entry.read), Some(Read::State([own])) if *own == field), "{name}");
        }
    }
}
