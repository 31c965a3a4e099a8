//! Machine code made for a model: which parts of a step have it, and running them.
//!
//! A part is recorded and compiled when it is first needed, once per model, number type and instruction set. Parts whose
//! straight-line code would be too large stay with the kernels.

mod contacts;
mod fields;
mod pairs;
mod parts;
mod patterns;
mod readers;
mod rounds;
mod rows;
mod solver;
mod structure;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use lanesim_codegen::{Block, CompileError, FieldSlice, Float, Fragment, InstructionSet, Program, Scratch};
use lanesim_kernels::code::{Code, ContactPart, Outside, SolverPart};
use lanesim_kernels::collision::{Collision, Found as FoundContact, Near};
use lanesim_kernels::constraint::{self, Constraint, ContactRow, DofRow, Kind, Motion, all_dof_rows};
use lanesim_kernels::lane::{Lane, Real};
use lanesim_kernels::model::{Model as Tables, Pair, Quantities, Quantity, Sides, Varied};
use lanesim_kernels::options;
use lanesim_kernels::pipeline::Findings;
use lanesim_kernels::position::Position;
use lanesim_kernels::solver::contact::Contacts;
use lanesim_kernels::solver::{Problem, Rounds, SolverWork};
use lanesim_kernels::state::State;
use lanesim_kernels::workspace::Workspace;

use contacts::{ContactCode, Places};
use pairs::{NarrowCode, NearCode};
use parts::SmoothKind;
use patterns::{Found, Patterns};
use readers::{AllReaders, Readers};
use rounds::Bound;
use rows::{RowCode, RowPlaces};
use structure::Structure;

/// Operations beyond which a part stays with the kernels: its code would not stay in a core's cache.
const MOST_OPERATIONS: usize = 60_000;
/// Operations that the smooth stages take for a link, about, beside the factorisation.
const PER_LINK: usize = 500;
/// Operations beyond which not even what does not depend on the state is looked for.
const MOST_RECORDED: usize = 1 << 20;

/// Code of a part, made at first use; `None` if it cannot be had. There may be one for each of a million pairs.
type Part<T> = OnceLock<Option<Box<Fragment<T>>>>;

/// All code of a model for one number type and instruction set.
pub(crate) struct ModelCode<T: Float> {
    tables: Arc<Tables<T>>,
    isa: InstructionSet,
    /// What varies of what all parts may depend on.
    set: Quantities,
    /// Code where such varies, by what does.
    inertial: Mutex<Vec<Arc<ModelCode<T>>>>,
    /// The smooth stages and the integration.
    readers: AllReaders<T>,
    joints: Part<T>,
    /// All rows on joints that the model can have.
    dof_rows: Vec<DofRow>,
    structure: OnceLock<Structure<T>>,
    /// In the order of [`solver::ALL`].
    solver: [Part<T>; solver::ALL.len()],
    /// By pair; of pairs between the same links with contacts of the same kind that of the first.
    couple: Vec<Part<T>>,
    /// Numbers of contacts both sides of which move, likewise; and those with a grip that varies.
    both_sides: [Vec<Part<T>>; 2],
    /// That first pair of each.
    first_pair: Vec<u32>,
    contacts: ContactCode<T>,
    patterns: Patterns<T>,
    /// Whether all parts of Newton's iteration have code.
    rounds: OnceLock<bool>,
    near: OnceLock<NearCode<T>>,
    narrow: OnceLock<NarrowCode<T>>,
    /// With shared grips, and with those that vary.
    rows: [OnceLock<RowCode<T>>; 2],
}

impl<T: Float> ModelCode<T> {
    /// Nothing compiled yet.
    ///
    /// # Errors
    ///
    /// If this machine cannot run code of the instruction set, or the system does not allow new code.
    pub fn new(tables: &Arc<Tables<T>>, isa: InstructionSet) -> Result<Self, CompileError> {
        isa.check()?;
        let code = ModelCode::varying(tables, isa, Quantities::NONE);
        // Whether the system lets new code run shows at the first piece, however small.
        parts::probe::<T>().compile(isa)?;
        Ok(code)
    }

    /// The same where some quantities vary in all that is compiled.
    fn varying(tables: &Arc<Tables<T>>, isa: InstructionSet, set: Quantities) -> Self {
        ModelCode {
            tables: tables.clone(),
            isa,
            set,
            inertial: Mutex::default(),
            readers: AllReaders::new(tables, set),
            joints: Part::new(),
            dof_rows: all_dof_rows(tables).collect(),
            structure: OnceLock::new(),
            solver: Default::default(),
            couple: tables.pairs.iter().map(|_| Part::new()).collect(),
            both_sides: [(); 2].map(|()| tables.pairs.iter().map(|_| Part::new()).collect()),
            first_pair: first_pairs(tables),
            contacts: ContactCode::default(),
            patterns: Patterns::new(tables),
            rounds: OnceLock::new(),
            near: OnceLock::new(),
            narrow: OnceLock::new(),
            rows: Default::default(),
        }
    }

    /// The code for a set in which the inertia matrix varies; `tables` is the model whose structure allows for it.
    fn inertial(&self, tables: &Arc<Tables<T>>, set: Quantities) -> Arc<ModelCode<T>> {
        let mut all = self.inertial.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = all.iter().find(|known| known.set == set) {
            return known.clone();
        }
        let made = Arc::new(ModelCode::varying(tables, self.isa, set));
        all.push(made.clone());
        made
    }

    /// The instruction set.
    pub fn isa(&self) -> InstructionSet {
        self.isa
    }

    fn get<'a>(
        &self,
        name: &str,
        part: &'a Part<T>,
        operations: impl FnOnce(&Tables<T>) -> usize,
        record: impl FnOnce(&Tables<T>) -> Program<T>,
    ) -> Option<&'a Fragment<T>> {
        self.get_by(name, part, operations, |tables| record(tables).compile(self.isa))
    }

    fn get_by<'a>(
        &self,
        name: &str,
        part: &'a Part<T>,
        operations: impl FnOnce(&Tables<T>) -> usize,
        compile: impl FnOnce(&Tables<T>) -> Result<Fragment<T>, CompileError>,
    ) -> Option<&'a Fragment<T>> {
        part.get_or_init(|| {
            let small = operations(&self.tables) <= MOST_OPERATIONS;
            if small { compile(&self.tables).ok().map(|code| Box::new(code.named(name))) } else { None }
        })
        .as_deref()
    }

    fn smooth<'a>(&self, readers: &'a Readers<T>, kind: SmoothKind) -> Option<&'a Fragment<T>> {
        self.get("smooth", readers.smooth(kind), parts::operations_of_smooth, |_| {
            parts::smooth(&readers.tables, kind, readers.set)
        })
    }

    fn euler<'a>(&self, readers: &'a Readers<T>) -> Option<&'a Fragment<T>> {
        self.get(
            "euler",
            &readers.euler,
            |_| parts::operations_of_euler(&readers.tables),
            |_| parts::euler(&readers.tables, readers.set),
        )
    }

    fn joints(&self) -> Option<&Fragment<T>> {
        self.get("joints", &self.joints, |tables| 60 * tables.limits.len(), |tables| parts::joints(tables, self.set))
    }

    fn structure(&self) -> &Structure<T> {
        self.structure.get_or_init(|| {
            let sizes = &self.tables.sizes;
            let small = PER_LINK * sizes.nlink + 10 * sizes.nm <= MOST_RECORDED;
            if small { Structure::new(&self.tables, self.set) } else { Structure::unknown() }
        })
    }

    #[inline]
    fn solver(&self, part: SolverPart) -> Option<&Fragment<T>> {
        // The test of convergence has the mean inertia as a constant.
        if part == SolverPart::Gather && self.set.has(Quantity::MeanInertia) {
            return None;
        }
        let number = solver::number(part);
        let record = |tables: &Tables<T>| solver::record(tables, self.structure(), part);
        self.get(solver::NAMES[number], &self.solver[number], |tables| solver::operations(part, tables), record)
    }

    fn couple(&self, pair: u32) -> Option<&Fragment<T>> {
        let first = self.first_pair[pair as usize] as usize;
        let operations = |tables: &Tables<T>| tables.sizes.nm;
        let columns = contacts::COUPLE.map(|(_, column)| column);
        let program = |tables: &Tables<T>| solver::couple(tables, &tables.pairs[first]);
        self.get_by("couple", &self.couple[first], operations, |tables| {
            program(tables).compile_each::<{ contacts::COUPLED }>(self.isa, &columns)
        })
    }

    fn both_sides(&self, pair: u32, varying: bool) -> Option<&Fragment<T>> {
        let first = self.first_pair[pair as usize] as usize;
        let operations = |tables: &Tables<T>| rows::operations_of_both(&tables.pairs[first]);
        let record = |tables: &Tables<T>| rows::record_both(tables, self.structure(), &tables.pairs[first], varying);
        self.get("rows", &self.both_sides[usize::from(varying)][first], operations, record)
    }

    fn rows(&self, varying: bool) -> &RowCode<T> {
        self.rows[usize::from(varying)].get_or_init(|| RowCode::new(&self.tables, varying))
    }

    fn contact(&self, part: ContactPart, kind: Kind) -> Option<&Fragment<T>> {
        self.contacts.get(part, kind, self.structure().live, self.isa)
    }

    /// Whether pairs are both links, or there are equality constraints, and whether some join branches.
    fn joins(&self) -> (bool, bool) {
        let (pairs, equalities) = (&self.tables.pairs, &self.tables.equalities);
        let both = pairs.iter().any(|pair| pair.sides != Sides::One) || !equalities.is_empty();
        (both, pairs.iter().any(|pair| pair.cross) || equalities.iter().any(|equality| equality.cross))
    }

    /// Whether all parts of Newton's iteration have code, but for those of single pairs.
    fn has_rounds(&self) -> bool {
        *self.rounds.get_or_init(|| {
            let (both, joins) = self.joins();
            let mut parts = solver::ALL.into_iter().filter(|part| solver::wanted(*part, true, both, joins));
            let of_kind = |kind: &Kind| {
                let mut parts = contacts::ALL.into_iter().filter(|(part, _)| contacts::applies(*part, *kind));
                parts.all(|(part, _)| self.contact(part, *kind).is_some())
            };
            parts.all(|part| self.solver(part).is_some()) && constraint::kinds(&self.tables).iter().all(of_kind)
        })
    }

    /// Whether the factor on a filled pattern has code.
    fn has_pattern(&self, place: usize) -> bool {
        let parts = [SolverPart::Descend { filled: true }, SolverPart::Polish { filled: true }];
        parts.into_iter().all(|part| self.patterns.get(self, place, part).is_some())
    }

    fn near(&self) -> &NearCode<T> {
        self.near.get_or_init(|| NearCode::new(&self.tables, self.isa))
    }

    fn narrow(&self) -> &NarrowCode<T> {
        self.narrow.get_or_init(|| NarrowCode::new(&self.tables))
    }

    /// Makes the code that a plain step runs, and names it; `None`: that part stays with the kernels.
    pub fn parts(&self) -> Vec<(String, Option<&Fragment<T>>)> {
        let smooth = self.smooth(&self.readers.first, SmoothKind { applied: false, keep: false });
        let mut all = vec![("smooth".to_owned(), smooth)];
        if self.tables.options.integrator == options::Integrator::Euler {
            all.push(("euler".to_owned(), self.euler(&self.readers.first)));
        }
        all.extend(
            self.near().groups.iter().enumerate().map(|(g, group)| (format!("near {g}"), Some(&group.fragment))),
        );
        all.extend(self.narrow().parts(self.isa));
        let solver = self.tables.options.solver;
        if !self.tables.constrained() || solver == options::Solver::Pgs {
            return all;
        }
        if !self.tables.equalities.is_empty() {
            all.push(("equality constraints".to_owned(), None));
        }
        let newton = solver == options::Solver::Newton;
        let (both, joins) = self.joins();
        all.push(("joints".to_owned(), self.joints()));
        all.extend(self.rows(false).parts((&self.tables, self.structure().live, self.isa)));
        for part in solver::ALL.into_iter().filter(|part| solver::wanted(*part, newton, both, joins)) {
            all.push((format!("solver.{}", solver::NAMES[solver::number(part)]), self.solver(part)));
        }
        for kind in constraint::kinds(&self.tables) {
            for (part, name) in contacts::ALL.into_iter().filter(|(part, _)| contacts::applies(*part, kind)) {
                let Kind { sides, cone, dim } = kind;
                all.push((format!("contact.{name} {sides:?} {cone:?} {dim}"), self.contact(part, kind)));
            }
        }
        all
    }
}

/// For every pair the first one between the same links with contacts of the same kind and law of impedance.
fn first_pairs<T>(tables: &Tables<T>) -> Vec<u32> {
    let mut first = HashMap::new();
    let impedance = |pair: &Pair<T>| (pair.impedance.flat, pair.impedance.small_power);
    let keys = tables.pairs.iter().map(|pair| (pair.link1, pair.link2, pair.condim, impedance(pair)));
    keys.zip(0..).map(|(key, pair)| *first.entry(key).or_insert(pair)).collect()
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
    /// Where nothing varies.
    base: Arc<ModelCode<T>>,
    code: Arc<ModelCode<T>>,
    /// What of the code depends on what varies.
    readers: Arc<Readers<T>>,
    scratch: Scratch,
    /// Of the contacts of the present solve.
    places: Places,
    /// Patterns that contacts have filled in.
    filled: Found,
    /// Of contacts while their numbers are written.
    row_places: RowPlaces<{ rows::COLUMNS }>,
    /// The same with grips that vary.
    varied_places: RowPlaces<{ rows::COLUMNS + 1 }>,
    /// Masks that the bounding tests return.
    words: Vec<u32>,
    /// Where capsules are parallel, as 1 and 0.
    parallel: Vec<T::Block>,
}

impl<T: Float> Native<T> {
    pub fn new(code: Arc<ModelCode<T>>) -> Self {
        let most = code.tables.capacity().contacts;
        let places = Places::with_capacity(most, constraint::kinds(&code.tables).len());
        let filled = Found::new(&code.tables);
        let row_places = RowPlaces::with_capacity(most, most);
        let varied_places = RowPlaces::with_capacity(0, 0);
        let (words, parallel) = (Vec::new(), Vec::new());
        Native {
            readers: code.readers.first.clone(),
            base: code.clone(),
            code,
            scratch: Scratch::new(),
            places,
            filled,
            row_places,
            varied_places,
            words,
            parallel,
        }
    }
}

/// Friction and inverse weights of pairs, where they vary.
fn grips<L: Lane>(varied: Option<&Varied<L>>) -> &[L] {
    varied.map_or(&[], |varied| varied.lanes(Quantity::Grip))
}

/// Most fields that the smooth stages have.
const SMOOTH_FIELDS: usize = 64;
/// Fields of the integration, beside what varies.
const EULER_FIELDS: usize = 15;
/// Fields of the rows on joints, likewise.
const JOINT_FIELDS: usize = 3;

impl<L: Block> Code<L> for Native<L::Float> {
    fn vary(&mut self, model: &Arc<Tables<L::Float>>, set: Quantities) {
        let all = !set.and(readers::INERTIAL).is_empty();
        // A new one from the start: calls and places of patterns that were kept are those of the code as it was.
        *self = Native::new(self.base.clone());
        self.code = if all { self.base.inertial(model, set) } else { self.base.clone() };
        self.readers = if all { self.code.readers.first.clone() } else { self.code.readers.get(model, set) };
        if set.has(Quantity::Grip) {
            let most = self.code.tables.capacity().contacts;
            self.varied_places = RowPlaces::with_capacity(most, most);
        }
    }

    fn smooth(
        &mut self,
        state: &State<L>,
        (applied, varied): Outside<'_, L>,
        keep: bool,
        ws: &mut Workspace<L>,
    ) -> Option<Findings<u32>> {
        let fragment = self.code.smooth(&self.readers, SmoothKind { applied: applied.is_some(), keep })?;
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
        parts::varied_fields(varied, readers::SMOOTH, |lanes| put(FieldSlice::read(lanes)));
        parts::smooth_fields(&self.code.tables, keep, ws.smooth(), &mut |lanes| put(FieldSlice::write(lanes)));
        let mut masks = [0; 5];
        fragment.run(&mut self.scratch, &mut fields[..count], &[], &mut masks);
        Some(masks.into())
    }

    fn groups(&self) -> usize {
        self.code.near().groups.len()
    }

    fn near(&mut self, group: usize, position: &Position<L>, alive: u32, near: &mut [u32], gaps: &mut [L; 2]) -> bool {
        self.code.near().groups[group].run(&mut self.scratch, &mut self.words, position, alive, near, gaps)
    }

    fn narrow(&mut self, position: &Position<L>, near: &[Near], found: &mut [FoundContact<L>]) -> bool {
        let code = self.code.narrow();
        code.run(self.code.isa, &mut self.scratch, &mut self.parallel, position, near, found)
    }

    fn euler(
        &mut self,
        state: &mut State<L>,
        varied: Option<&Varied<L>>,
        alive: u32,
        ws: &mut Workspace<L>,
    ) -> Option<u32> {
        let fragment = self.code.euler(&self.readers)?;
        let solver = &ws.solver.fields;
        let next = &mut ws.integration;
        let zero = [L::Float::from_f64(0.0)];
        let mut count = EULER_FIELDS;
        let mut fields = [
            FieldSlice::write(&mut state.qpos),
            FieldSlice::write(&mut state.qvel),
            FieldSlice::write(&mut state.qacc_warmstart),
            FieldSlice::write(&mut state.time),
            FieldSlice::read(&ws.inertia.m),
            FieldSlice::read(ws.inertia.link.as_flattened()),
            FieldSlice::read(ws.position.cdof.as_flattened()),
            FieldSlice::read(&ws.acceleration.qacc_smooth),
            FieldSlice::read(&solver.qacc),
            FieldSlice::read(&ws.acceleration.qfrc_smooth),
            FieldSlice::read(&solver.qfrc_constraint),
            FieldSlice::uniform(&zero),
            FieldSlice::write(&mut next.qpos),
            FieldSlice::write(&mut next.qvel),
            FieldSlice::write(&mut next.qacc),
            FieldSlice::unused(),
            FieldSlice::unused(),
        ];
        parts::varied_fields(varied, readers::EULER, |lanes| {
            fields[count] = FieldSlice::read(lanes);
            count += 1;
        });
        let mut good = [0];
        fragment.run(&mut self.scratch, &mut fields[..count], &[alive], &mut good);
        Some(good[0])
    }

    fn dof_rows(&mut self, state: &State<L>, varied: Option<&Varied<L>>, constraint: &mut Constraint<L>) -> bool {
        let code = &self.code;
        if code.tables.options.solver == options::Solver::Pgs {
            return false;
        }
        let Some(fragment) = code.joints() else { return false };
        if constraint.dof_rows.len() != code.dof_rows.len() {
            constraint.dof_rows.clone_from(&code.dof_rows);
            constraint.dof_lanes.resize(code.dof_rows.len(), [L::zero(); 6]);
        }
        let mut fields = [
            FieldSlice::read(&state.qpos),
            FieldSlice::read(&state.qvel),
            FieldSlice::write(constraint.dof_lanes.as_flattened_mut()),
            FieldSlice::unused(),
            FieldSlice::unused(),
        ];
        let mut count = JOINT_FIELDS;
        parts::varied_fields(varied, readers::JOINTS, |lanes| {
            fields[count] = FieldSlice::read(lanes);
            count += 1;
        });
        let mut act = [0];
        fragment.run(&mut self.scratch, &mut fields[..count], &[], &mut act);
        constraint.joint_lanes = act[0];
        true
    }

    fn still_sides(
        &mut self,
        motion: Motion<'_, L>,
        collision: &Collision<L>,
        varied: Option<&Varied<L>>,
        constraint: &mut Constraint<L>,
    ) -> bool {
        let Native { code, scratch, row_places, varied_places, .. } = self;
        let how = (&*code.tables, code.structure().live, code.isa);
        match grips(varied) {
            [] => code.rows(false).still_sides(how, (scratch, row_places), motion, (collision, &[]), constraint),
            all => code.rows(true).still_sides(how, (scratch, varied_places), motion, (collision, all), constraint),
        }
    }

    fn both_sides(
        &mut self,
        motion: Motion<'_, L>,
        (collision, row): (&Collision<L>, &ContactRow),
        varied: Option<&Varied<L>>,
        constraint: &mut Constraint<L>,
    ) -> bool {
        let (code, grips) = (&self.code, grips(varied));
        let Some(fragment) = code.both_sides(row.pair, !grips.is_empty()) else { return false };
        let dofs = code.tables.pairs[row.pair as usize].dofs.len as usize;
        let rows = code.rows(!grips.is_empty());
        rows.both_sides(fragment, &mut self.scratch, motion, (collision, grips), (row, dofs), constraint);
        true
    }

    fn contacts(&mut self, constraint: &Constraint<L>) {
        self.places.place(constraint);
    }

    fn solver(
        &mut self,
        part: SolverPart,
        problem: &Problem<'_, L>,
        warmstart: &[L],
        open: u32,
        work: &mut SolverWork<L>,
    ) -> Option<[u32; 2]> {
        let fragment = self.code.solver(part)?;
        let (names, _) = solver::fields(part);
        let table = fields::table(problem, warmstart, work);
        let mut fields: [_; solver::MOST_FIELDS] = fields::pick(&table, names.iter().copied());
        let (mut masks, (given, returned)) = ([0; 2], solver::masks(part));
        fragment.run(&mut self.scratch, &mut fields[..names.len()], &[open][..given], &mut masks[..returned]);
        Some(masks)
    }

    fn contact(
        &mut self,
        part: ContactPart,
        contacts: Contacts<'_>,
        problem: &Problem<'_, L>,
        open: u32,
        work: &mut SolverWork<L>,
    ) -> bool {
        let Some(fragment) = self.code.contact(part, contacts.kind) else { return false };
        let names = contacts::fields(part);
        let table = fields::table(problem, &[], work);
        let mut fields: [_; contacts::MOST_FIELDS] = fields::pick(&table, names.iter().map(|(name, _)| *name));
        let windows = self.places.all(contacts.number);
        fragment.run_each(&mut self.scratch, &mut fields[..names.len()], &[open][..contacts::masks(part)], windows);
        true
    }

    fn couple(&mut self, problem: &Problem<'_, L>, row: &ContactRow, work: &mut SolverWork<L>) -> bool {
        let found = self.code.couple(row.pair).zip(self.places.coupling_of(row));
        let Some((fragment, number)) = found else { return false };
        let table = fields::table(problem, &[], work);
        let mut fields: [_; contacts::COUPLE.len()] =
            fields::pick(&table, contacts::COUPLE.into_iter().map(|(name, _)| name));
        fragment.run_each(&mut self.scratch, &mut fields, &[], self.places.coupling(number));
        true
    }

    fn rounds(
        &mut self,
        problem: &Problem<'_, L>,
        warmstart: &[L],
        work: &mut SolverWork<L>,
        run: &mut dyn FnMut(&mut dyn Rounds),
    ) -> bool {
        let Native { code, scratch, places, filled, .. } = self;
        let lent = (scratch, places, filled);
        let Some(mut rounds) = Bound::new(code, lent, problem, warmstart, work) else { return false };
        run(&mut rounds);
        true
    }
}
