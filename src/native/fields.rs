//! The fields that code for the solver reads and writes, by name.

use lanesim_codegen::{Block, FieldSlice, Recorder};
use lanesim_kernels::solver::{Problem, Solver, SolverWork};

/// A field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    Axes,
    Inertia,
    SmoothForce,
    SmoothAcceleration,
    WarmStart,
    Joints,
    Strengths,
    Motion,
    Jacobian,
    Reference,
    Search,
    MSearch,
    Gradient,
    Qacc,
    Ma,
    QfrcConstraint,
    Pull,
    Twist,
    ColdTwist,
    Wrench,
    Stiffness,
    Hessian,
    Inverse,
    Line,
    JointY,
    JointJp,
    JointForce,
    Y,
    Jp,
    Force,
}

/// Number of fields.
pub const FIELDS: usize = Field::Force as usize + 1;

/// All fields.
pub type Table<'a, T> = [FieldSlice<'a, T>; FIELDS];

/// All fields as they are, in the order of [`Field`].
#[inline]
pub fn table<'a, L: Block>(
    problem: &Problem<'a, L>,
    warmstart: &'a [L],
    work: &'a mut SolverWork<L>,
) -> Table<'a, L::Float> {
    let Problem { position, inertia, acceleration, constraint, .. } = *problem;
    let SolverWork { fields, y, jp, force, line, .. } = work;
    let Solver { search, msearch, gradient, qacc, ma, qfrc_constraint, pull, .. } = fields;
    let Solver { twist, cold_twist, wrench, stiffness, hessian, inverse, .. } = fields;
    [
        FieldSlice::read(position.cdof.as_flattened()),
        FieldSlice::read(&inertia.m),
        FieldSlice::read(&acceleration.qfrc_smooth),
        FieldSlice::read(&acceleration.qacc_smooth),
        FieldSlice::read(warmstart),
        FieldSlice::read(constraint.dof_lanes.as_flattened()),
        FieldSlice::read(constraint.strengths.as_flattened()),
        FieldSlice::read(constraint.motion.as_flattened()),
        FieldSlice::read(&constraint.jacobian),
        FieldSlice::read(&constraint.reference),
        FieldSlice::write(search),
        FieldSlice::write(msearch),
        FieldSlice::write(gradient),
        FieldSlice::write(qacc),
        FieldSlice::write(ma),
        FieldSlice::write(qfrc_constraint),
        FieldSlice::write(pull),
        FieldSlice::write(twist.as_flattened_mut()),
        FieldSlice::write(cold_twist.as_flattened_mut()),
        FieldSlice::write(wrench.as_flattened_mut()),
        FieldSlice::write(stiffness.as_flattened_mut()),
        FieldSlice::write(hessian),
        FieldSlice::write(inverse),
        FieldSlice::write(&mut line.0),
        FieldSlice::write(&mut y.dof),
        FieldSlice::write(&mut jp.dof),
        FieldSlice::write(&mut force.dof),
        FieldSlice::write(&mut y.component),
        FieldSlice::write(&mut jp.component),
        FieldSlice::write(&mut force.component),
    ]
}

/// Some of the fields once more.
#[inline]
pub fn pick<'a, T: lanesim_codegen::Float, const N: usize>(
    table: &Table<'a, T>,
    fields: impl Iterator<Item = Field>,
) -> [FieldSlice<'a, T>; N] {
    let mut out = [const { FieldSlice::unused() }; N];
    for (out, field) in out.iter_mut().zip(fields) {
        *out = table[field as usize].again();
    }
    out
}

impl Field {
    /// Whether whoever reads it knows which of its entries no motion has: those stay as they are.
    pub fn is_dead(self, entry: usize, live: [bool; 6]) -> bool {
        match self {
            Field::Twist | Field::ColdTwist | Field::Wrench => !live[entry % 6],
            Field::Stiffness => {
                let entries = (0..6).flat_map(|i| (0..=i).map(move |j| (i, j)));
                entries.skip(entry % 21).take(1).any(|(i, j)| !live[i] || !live[j])
            }
            _ => false,
        }
    }

    /// The field among the solver's, to be recorded; `None` if it is another stage's or one of contacts.
    pub fn of_solver<T: lanesim_codegen::Float>(
        self,
        work: &mut SolverWork<Recorder<T>>,
    ) -> Option<&mut [Recorder<T>]> {
        let SolverWork { fields, y, jp, force, line, .. } = work;
        Some(match self {
            Field::Search => &mut fields.search,
            Field::MSearch => &mut fields.msearch,
            Field::Gradient => &mut fields.gradient,
            Field::Qacc => &mut fields.qacc,
            Field::Ma => &mut fields.ma,
            Field::QfrcConstraint => &mut fields.qfrc_constraint,
            Field::Pull => &mut fields.pull,
            Field::Twist => fields.twist.as_flattened_mut(),
            Field::ColdTwist => fields.cold_twist.as_flattened_mut(),
            Field::Wrench => fields.wrench.as_flattened_mut(),
            Field::Stiffness => fields.stiffness.as_flattened_mut(),
            Field::Hessian => &mut fields.hessian,
            Field::Inverse => &mut fields.inverse,
            Field::Line => &mut line.0,
            Field::JointY => &mut y.dof,
            Field::JointJp => &mut jp.dof,
            Field::JointForce => &mut force.dof,
            _ => return None,
        })
    }
}
