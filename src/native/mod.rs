//! Machine code made for a model: which parts of a step have it, and running them.
//!
//! A part is recorded and compiled when it is first needed, once per model, number type and instruction set. Parts whose
//! straight-line code would be too large stay with the kernels.

mod contacts;
mod parts;

use std::sync::{Arc, OnceLock};

use lanesim_codegen::{Block, CompileError, FieldSlice, Float, Fragment, InstructionSet, Program, Scratch};
use lanesim_kernels::code::Code;
use lanesim_kernels::constraint::Constraint;
use lanesim_kernels::model::Model as Tables;
use lanesim_kernels::options;
use lanesim_kernels::solver::contact::{Contacts, Kind};
use lanesim_kernels::solver::edges::Edges;
use lanesim_kernels::solver::{Problem, Solver};
use lanesim_kernels::state::{Applied, State};
use lanesim_kernels::workspace::Workspace;

use contacts::{ContactCode, ContactPart, Places};
use parts::{SmoothKind, SolverPart};

/// Operations beyond which a part stays with the kernels: its code would not stay in a core's cache.
const MOST_OPERATIONS: usize = 60_000;
/// Operations that the smooth stages take for a link, about, beside the factorisation.
const PER_LINK: usize = 500;

/// Code of a part, made at first use; `None` if it cannot be had.
type Part<T> = OnceLock<Option<Fragment<T>>>;

/// All code of a model for one number type and instruction set.
pub(crate) struct ModelCode<T: Float> {
    tables: Arc<Tables<T>>,
    isa: InstructionSet,
    /// By [`SmoothKind`]: with forces from outside, and for readers of fields.
    smooth: [[Part<T>; 2]; 2],
    euler: Part<T>,
    motion: Part<T>,
    curve: Part<T>,
    /// With the inertia matrix's pattern, and the filled one.
    descend: [Part<T>; 2],
    /// The same.
    polish: [Part<T>; 2],
    gather: Part<T>,
    contacts: ContactCode<T>,
}

impl<T: Float> ModelCode<T> {
    /// Nothing compiled yet.
    ///
    /// # Errors
    ///
    /// If this machine cannot run code of the instruction set, or the system does not allow new code.
    pub fn new(tables: &Arc<Tables<T>>, isa: InstructionSet) -> Result<Self, CompileError> {
        isa.check()?;
        let code = ModelCode {
            tables: tables.clone(),
            isa,
            smooth: Default::default(),
            euler: Part::new(),
            motion: Part::new(),
            curve: Part::new(),
            descend: Default::default(),
            polish: Default::default(),
            gather: Part::new(),
            contacts: ContactCode::default(),
        };
        // Whether the system lets new code run shows at the first piece.
        let euler = parts::euler(tables).compile(isa)?;
        code.euler.get_or_init(|| Some(euler));
        Ok(code)
    }

    /// The instruction set.
    pub fn isa(&self) -> InstructionSet {
        self.isa
    }

    fn get<'a>(
        &self,
        part: &'a Part<T>,
        operations: impl FnOnce(&Tables<T>) -> usize,
        record: impl FnOnce(&Tables<T>) -> Program<T>,
    ) -> Option<&'a Fragment<T>> {
        part.get_or_init(|| {
            let small = operations(&self.tables) <= MOST_OPERATIONS;
            if small { record(&self.tables).compile(self.isa).ok() } else { None }
        })
        .as_ref()
    }

    fn smooth(&self, kind: SmoothKind) -> Option<&Fragment<T>> {
        let part = &self.smooth[usize::from(kind.applied)][usize::from(kind.keep)];
        let operations = |tables: &_| PER_LINK * self.tables.sizes.nlink + parts::work_of_factor(tables, false);
        self.get(part, operations, |tables| parts::smooth(tables, kind))
    }

    fn solver(&self, part: SolverPart) -> Option<&Fragment<T>> {
        let place = match part {
            SolverPart::Motion => &self.motion,
            SolverPart::Curve => &self.curve,
            SolverPart::Descend { filled } => &self.descend[usize::from(filled)],
            SolverPart::Polish { filled } => &self.polish[usize::from(filled)],
            SolverPart::Gather => &self.gather,
        };
        self.get(place, |tables| part.operations(tables), |tables| parts::solver(tables, part))
    }

    fn contact(&self, part: ContactPart, kind: Kind) -> Option<&Fragment<T>> {
        self.contacts.get(part, kind, self.isa)
    }

    /// Makes the code that a plain step runs, and names it; `None`: that part stays with the kernels.
    pub fn parts(&self) -> Vec<(String, Option<&Fragment<T>>)> {
        let mut all = vec![
            ("smooth".to_owned(), self.smooth(SmoothKind { applied: false, keep: false })),
            ("euler".to_owned(), self.euler.get().and_then(Option::as_ref)),
        ];
        let solver = self.tables.options.solver;
        if !self.tables.constrained() || solver == options::Solver::Pgs {
            return all;
        }
        let newton = solver == options::Solver::Newton;
        let joins = self.tables.pairs.iter().any(|pair| pair.cross);
        let parts = [
            ("motion", SolverPart::Motion, true),
            ("gather", SolverPart::Gather, true),
            ("curve", SolverPart::Curve, newton),
            ("descend", SolverPart::Descend { filled: false }, newton),
            ("descend filled", SolverPart::Descend { filled: true }, newton && joins),
        ];
        let wanted = parts.into_iter().filter(|(.., wanted)| *wanted);
        all.extend(wanted.map(|(name, part, _)| (format!("solver.{name}"), self.solver(part))));
        for kind in contacts::kinds(&self.tables) {
            for (part, name) in ContactPart::ALL {
                all.push((format!("contact.{name} {:?} {}", kind.cone, kind.dim), self.contact(part, kind)));
            }
        }
        all
    }
}

/// The code of a model for one number type, by instruction set, made at first use.
pub(crate) struct Codes<T: Float>([OnceLock<Result<Arc<ModelCode<T>>, String>>; 2]);

impl<T: Float> Default for Codes<T> {
    fn default() -> Self {
        Codes(Default::default())
    }
}

impl<T: Float> Codes<T> {
    /// The code for an instruction set, or the best that the machine has; if there can be none, why.
    pub fn get(&self, tables: &Arc<Tables<T>>, isa: Option<InstructionSet>) -> Result<Arc<ModelCode<T>>, String> {
        let isa = isa.map_or_else(InstructionSet::detect, Ok).map_err(|e| e.to_string())?;
        let place = &self.0[usize::from(isa == InstructionSet::Avx512)];
        place.get_or_init(|| ModelCode::new(tables, isa).map(Arc::new).map_err(|e| e.to_string())).clone()
    }
}

impl<T: Float> std::fmt::Debug for Codes<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Codes").finish_non_exhaustive()
    }
}

/// A worker's way to the code.
pub(crate) struct Native<T: Float> {
    code: Arc<ModelCode<T>>,
    scratch: Scratch,
    /// Of the contacts of the present solve.
    places: Places,
}

impl<T: Float> Native<T> {
    pub fn new(code: Arc<ModelCode<T>>) -> Self {
        let most = code.tables.capacity().contacts;
        Native { code, scratch: Scratch::new(), places: Places::with_capacity(most, most) }
    }

    /// Inlined, so that the fields of a part are known where it is run.
    #[inline(always)]
    fn solver(
        &mut self,
        part: SolverPart,
        problem: &Problem<'_, T::Block>,
        solver: &mut Solver<T::Block>,
        masks_in: &[u32],
        masks_out: &mut [u32],
    ) -> bool {
        let Some(fragment) = self.code.solver(part) else { return false };
        let ([a, b, c, d, e, f, g, h, i], _) = part.fields(solver);
        let mut fields = [
            FieldSlice::read(problem.position.cdof.as_flattened()),
            FieldSlice::read(&problem.inertia.m),
            FieldSlice::read(&problem.acceleration.qfrc_smooth),
            FieldSlice::write(a),
            FieldSlice::write(b),
            FieldSlice::write(c),
            FieldSlice::write(d),
            FieldSlice::write(e),
            FieldSlice::write(f),
            FieldSlice::write(g),
            FieldSlice::write(h),
            FieldSlice::write(i),
        ];
        fragment.run(&mut self.scratch, &mut fields, masks_in, masks_out);
        true
    }
}

/// Most fields that the smooth stages have.
const SMOOTH_FIELDS: usize = 64;

impl<L: Block> Code<L> for Native<L::Float> {
    fn smooth(
        &mut self,
        state: &State<L>,
        applied: Option<&Applied<L>>,
        keep: bool,
        ws: &mut Workspace<L>,
    ) -> Option<[u32; 2]> {
        let fragment = self.code.smooth(SmoothKind { applied: applied.is_some(), keep })?;
        let mut fields: [FieldSlice<'_, L::Float>; SMOOTH_FIELDS] = std::array::from_fn(|_| FieldSlice::unused());
        let mut count = 0;
        let mut put = |field| {
            fields[count] = field;
            count += 1;
        };
        [&state.qpos, &state.qvel, &state.ctrl].into_iter().for_each(|lanes| put(FieldSlice::read(lanes)));
        if let Some(applied) = applied {
            put(FieldSlice::read(&applied.qfrc_applied));
            put(FieldSlice::read(applied.xfrc_applied.as_flattened()));
        }
        parts::smooth_fields(&self.code.tables, keep, ws.smooth(), &mut |lanes| put(FieldSlice::write(lanes)));
        let mut masks = [0; 2];
        fragment.run(&mut self.scratch, &mut fields[..count], &[], &mut masks);
        Some(masks)
    }

    fn euler(&mut self, state: &State<L>, ws: &mut Workspace<L>) -> bool {
        let Some(fragment) = self.code.euler.get().and_then(Option::as_ref) else { return false };
        let solver = &ws.solver.fields;
        let next = &mut ws.integration;
        let mut fields: [FieldSlice<'_, L::Float>; 9] = [
            FieldSlice::read(&state.qpos),
            FieldSlice::read(&state.qvel),
            FieldSlice::read(&ws.inertia.m),
            FieldSlice::read(&solver.qacc),
            FieldSlice::read(&ws.acceleration.qfrc_smooth),
            FieldSlice::read(&solver.qfrc_constraint),
            FieldSlice::write(&mut next.qpos),
            FieldSlice::write(&mut next.qvel),
            FieldSlice::write(&mut next.qacc),
        ];
        fragment.run(&mut self.scratch, &mut fields, &[], &mut []);
        true
    }

    fn motion(&mut self, problem: &Problem<'_, L>, solver: &mut Solver<L>) -> bool {
        self.solver(SolverPart::Motion, problem, solver, &[], &mut [])
    }

    fn curve(&mut self, problem: &Problem<'_, L>, solver: &mut Solver<L>) -> bool {
        self.solver(SolverPart::Curve, problem, solver, &[], &mut [])
    }

    fn descend(&mut self, problem: &Problem<'_, L>, solver: &mut Solver<L>) -> bool {
        self.solver(SolverPart::Descend { filled: problem.constraint.cross }, problem, solver, &[], &mut [])
    }

    fn polish(&mut self, problem: &Problem<'_, L>, solver: &mut Solver<L>) -> bool {
        self.solver(SolverPart::Polish { filled: problem.constraint.cross }, problem, solver, &[], &mut [])
    }

    fn gather(&mut self, problem: &Problem<'_, L>, open: u32, solver: &mut Solver<L>) -> Option<[u32; 2]> {
        let mut arrived = [0; 2];
        self.solver(SolverPart::Gather, problem, solver, &[open], &mut arrived).then_some(arrived)
    }

    fn contacts(&mut self, constraint: &Constraint<L>) {
        contacts::place(constraint, &mut self.places);
    }

    fn survey(
        &mut self,
        constraint: &Constraint<L>,
        list: Contacts<'_>,
        twist: &[[L; 6]],
        y: &mut [L],
        twice: &mut [L; 1],
    ) -> bool {
        let Some(fragment) = self.code.contact(ContactPart::Survey, list.kind) else { return false };
        let windows = contacts::windows(&self.places, list);
        contacts::survey(fragment, &mut self.scratch, constraint, windows, twist, y, twice);
        true
    }

    fn approach(
        &mut self,
        constraint: &Constraint<L>,
        list: Contacts<'_>,
        twist: &[[L; 6]],
        y: &[L],
        jp: &mut [L],
        edges: &mut Edges<L>,
    ) -> bool {
        let Some(fragment) = self.code.contact(ContactPart::Approach, list.kind) else { return false };
        let windows = (list.kind.cone, contacts::windows(&self.places, list));
        contacts::approach(fragment, &mut self.scratch, constraint, windows, twist, y, jp, edges);
        true
    }

    fn act(
        &mut self,
        constraint: &Constraint<L>,
        list: Contacts<'_>,
        step: L,
        open: u32,
        jp: &[L],
        y: &mut [L],
        force: &mut [L],
        wrench: &mut [[L; 6]],
    ) -> bool {
        let Some(fragment) = self.code.contact(ContactPart::Act, list.kind) else { return false };
        let windows = contacts::windows(&self.places, list);
        contacts::act(fragment, &mut self.scratch, constraint, windows, (step, open), jp, y, force, wrench);
        true
    }

    fn stiffen(&mut self, constraint: &Constraint<L>, list: Contacts<'_>, y: &[L], stiffness: &mut [[L; 21]]) -> bool {
        let Some(fragment) = self.code.contact(ContactPart::Stiffen, list.kind) else { return false };
        let windows = contacts::windows(&self.places, list);
        contacts::stiffen(fragment, &mut self.scratch, constraint, windows, y, stiffness);
        true
    }

    fn every_link(&self) -> bool {
        true
    }
}
