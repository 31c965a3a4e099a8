//! The code of a model: part by part, made at first use, for each set of quantities that vary.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use lanesim_codegen::{
    CompileError, FieldSlice, Float, Fragment, InstructionSet, Lending, Recording, Scratch, Session,
};
use lanesim_kernels::collision::{self, Class, Near};
use lanesim_kernels::constraint::{self, Classes, ContactRow};
use lanesim_kernels::kick;
use lanesim_kernels::lane::LaneQuery;
use lanesim_kernels::model::{Model as Tables, Patch, Pattern, Quantities, Quantity, Sides};
use lanesim_kernels::options::{self, Integrator};
use lanesim_kernels::part::{
    COLUMNS, Family, Group, Item, KICKED, KIND_COLUMNS, Lanes, Op, Part, Step, Threes, stride,
};
use lanesim_kernels::solver::{self, Layout, Tile, Whitened, Work};
use lanesim_kernels::stage::Stage;

use super::patterns::Patterns;
use super::record::{MOST_OPERATIONS, Recorded, Source, Subject, record};
use super::structure::Structure;

/// Code of a part.
pub struct Coded<T> {
    pub fragment: Fragment<T>,
    /// Its fields in a step.
    pub sources: Vec<Source>,
    /// The same as a set.
    pub set: Threes,
}

impl<T: Float> Coded<T> {
    /// Makes it ready as a call of a session.
    #[cold]
    pub fn bind(&self, session: &mut Session<'_, T>, call: usize) {
        session.bind(call, &self.fragment, self.sources.iter().map(|source| source.field));
    }
}

/// A place for it, filled at first use; `None`: it cannot be had.
type Slot<T> = OnceLock<Option<Arc<Coded<T>>>>;

/// What all code of a model has in common.
pub struct Common<T> {
    pub isa: InstructionSet,
    /// Classes of pairs by their shapes, and a pair of each.
    shapes: Vec<(Class, Near)>,
    /// Classes of contacts.
    pub rows: Classes,
    groups: Vec<Vec<u32>>,
    /// Tiles by [`Work`] and shape, and whether there are such.
    tiles: Vec<Vec<(Tile, bool)>>,
    /// Tiles to which contacts add, by shape.
    patches: Vec<(ContactRow, Patch)>,
    /// Of every kind of contacts, where one has its whitened rows; of solvers that have none, nothing.
    whitened: Vec<Whitened>,
    /// By [`Op`], the number of its first part; then that of all.
    bases: Vec<usize>,
    /// Numbers that all worlds share, in the order of [`Quantity::SHARED`].
    shared: [Vec<T>; Quantity::SHARED.len()],
    /// The code for sets in which something varies.
    varying: Mutex<Vec<Arc<ModelCode<T>>>>,
}

/// Code of a model for one number type and instruction set, and one set of quantities that vary.
pub struct ModelCode<T> {
    pub tables: Arc<Tables<T>>,
    set: Quantities,
    pub common: Arc<Common<T>>,
    /// By number of part.
    slots: Vec<Slot<T>>,
    /// By number of part, what varies of what it depends on.
    reads: Vec<OnceLock<Quantities>>,
    structure: OnceLock<Structure<T>>,
    pub patterns: Arc<Patterns<T>>,
    /// Fields of parts of a solve; `None`: not all of these have code.
    solves: OnceLock<Option<Threes>>,
}

impl<T: Float> Common<T> {
    fn new(tables: &Tables<T>, isa: InstructionSet) -> Self {
        let near = |(class, number): (Class, u32)| {
            let points = tables.pairs[class.pair as usize].slots.len;
            (class, Near { pair: class.pair, worlds: u32::MAX, first: 0, points, class: number })
        };
        let shapes: Vec<_> = collision::classes(tables).0.into_iter().zip(0..).map(near).collect();
        let (of_pairs, rows) = constraint::rows_of_pairs(tables);
        let tiles: Vec<_> = Work::ALL.into_iter().map(|work| tiles_of(tables, work)).collect();
        let patch = |(pair, patch): &(u32, Patch)| (of_pairs[*pair as usize], *patch);
        let patches: Vec<_> = tables.tiles.shapes.iter().map(patch).collect();
        let layout = solver::needed(tables).then(|| Layout::new(tables));
        let whitened = layout.iter().flat_map(|layout| rows.kinds.iter().map(|row| layout.place(tables, row, [0; 2])));
        let whitened: Vec<Whitened> = whitened.collect();
        let groups = collision::groups(tables);
        let mut bases = vec![0];
        for op in Op::ALL {
            let stage = op.stage();
            let absent = match op {
                Op::Equality => tables.equalities.is_empty(),
                Op::Spread | Op::Aim => tables.tiles.is_empty(),
                Op::Motion | Op::Settle => tables.tiles.is_empty() && tables.own.is_empty(),
                Op::Sweep => layout.is_none(),
                Op::Combine => tables.options.integrator != Integrator::Rk4,
                _ => false,
            };
            let unkicked = *op == Op::Smooth && !kick::kicks(tables);
            let none = absent || !stage.present(tables) || stage == Stage::Solver && !tables.constrained();
            let count = match op.family() {
                _ if none => 0,
                Family::Options(_) if unkicked => KICKED as usize,
                Family::Options(count) => count as usize,
                Family::Group => groups.len(),
                Family::Shapes => shapes.len(),
                Family::Law => rows.laws.len(),
                Family::Links => rows.links.len(),
                Family::Couple => rows.couples.len(),
                Family::Kind => rows.kinds.len(),
                Family::Whitened => whitened.len(),
                Family::Tiles(work) => tiles[work as usize].len(),
                Family::Patches => patches.len(),
            };
            bases.push(bases.last().map_or(0, |last| last + count));
        }
        let width = <T::Block as LaneQuery>::WIDTH;
        let shared = |quantity: Quantity| {
            let (len, padding) = (quantity.width(), stride(quantity, width) - quantity.width());
            let numbers = quantity.of(tables);
            let zeros = std::iter::repeat_n(T::default(), padding);
            let padded = numbers.chunks(len).flat_map(|element| element.iter().copied().chain(zeros.clone()));
            let mut numbers: Vec<T> = padded.collect();
            numbers.truncate(numbers.len().saturating_sub(padding));
            numbers
        };
        let shared = Quantity::SHARED.map(shared);
        Common { isa, shapes, rows, groups, tiles, patches, whitened, bases, shared, varying: Mutex::default() }
    }

    /// Number of a part; `None`: it is of no class of the model.
    #[inline(always)]
    pub fn number(&self, part: Part) -> Option<usize> {
        let op = part.op as usize;
        let number = self.bases[op] + part.of as usize;
        (number < self.bases[op + 1]).then_some(number)
    }

    /// By [`Op`], the number of its first part.
    pub fn bases(&self) -> &[usize] {
        &self.bases
    }

    /// Number of all parts.
    pub fn count(&self) -> usize {
        self.bases[Op::ALL.len()]
    }

    /// All parts of an op.
    pub fn parts(&self, op: Op) -> impl Iterator<Item = Part> {
        let count = self.bases[op as usize + 1] - self.bases[op as usize];
        (0..count as u32).map(move |of| Part::of(op, of)).filter(|part| self.has(*part))
    }

    /// Whether there is such a part: some classes of a family are not those of an op.
    fn has(&self, part: Part) -> bool {
        match part.op {
            Op::Parallel => self.shapes[part.of as usize].0.capsules(),
            op => match op.family() {
                Family::Kind => op.applies(self.rows.kinds[part.of as usize].sides),
                Family::Tiles(work) => self.tiles[work as usize][part.of as usize].1,
                _ => true,
            },
        }
    }

    /// What a part is recorded for.
    pub fn item(&self, part: Part) -> Item<'_> {
        let of = part.of as usize;
        match part.op.family() {
            Family::Options(_) | Family::Group => Item::Whole,
            Family::Shapes => Item::Near(&self.shapes[of].1),
            Family::Law => Item::Row(&self.rows.laws[of]),
            Family::Links => Item::Row(&self.rows.links[of]),
            Family::Couple => Item::Row(&self.rows.couples[of]),
            Family::Kind => Item::Row(&self.rows.kinds[of]),
            Family::Whitened => Item::Whitened(&self.rows.kinds[of], &self.whitened[of]),
            Family::Tiles(work) => Item::Tile(&self.tiles[work as usize][of].0),
            Family::Patches => Item::Patch(&self.patches[of].0, &self.patches[of].1),
        }
    }

    /// Number of columns of the windows that its code runs for; 0: for the block, or one item.
    pub fn columns(&self, part: Part) -> usize {
        match part.op.family() {
            Family::Options(_) | Family::Group => 0,
            Family::Tiles(_) | Family::Patches | Family::Whitened => KIND_COLUMNS,
            Family::Kind if self.rows.kinds[part.of as usize].sides != Sides::Apart => KIND_COLUMNS,
            _ => COLUMNS,
        }
    }

    /// A part's name.
    pub fn name(&self, tables: &Tables<T>, part: Part) -> String {
        let (name, of) = (part.op.name(), part.of as usize);
        let row = match part.op.family() {
            Family::Options(_) => {
                if part.op == Op::Smooth {
                    let (kicked, of) = (of >= KICKED as usize, of % KICKED as usize);
                    let start = ["", " from velocities", " from controls"][of >> 2];
                    let fields = ["", ", forces", ", all fields", ", forces, all fields"][of & 3];
                    return format!("{name}{start}{fields}{}", if kicked { ", kicked" } else { "" });
                }
                let options = match (part.op, of) {
                    (Op::Descend | Op::Polish, 1) => " filled",
                    (Op::Probe | Op::Conjugate, 1) => " first",
                    (Op::Sweep, of) => ["", " without slip", " of contacts alone"][of],
                    (Op::Combine, of) => [" first", " second", " third", " last"][of],
                    _ => "",
                };
                return format!("{name}{options}");
            }
            Family::Group => return format!("{name} {of}"),
            Family::Shapes => return format!("{name} {}", self.shapes[of].0.name()),
            Family::Law => &self.rows.laws[of],
            Family::Links => &self.rows.links[of],
            Family::Couple => &self.rows.couples[of],
            Family::Kind | Family::Whitened => &self.rows.kinds[of],
            Family::Tiles(work) => {
                let lens = tables.tiles.lens_of(part.of, work.strips());
                return lens.iter().fold(name.to_owned(), |name, len| format!("{name} {len}"));
            }
            Family::Patches => {
                let (row, Patch { rows, columns, stride, .. }) = &self.patches[of];
                return format!("{name} {}, {} by {} of {stride}", row.dim, rows.len, columns.len);
            }
        };
        let kind = format!("{name} {:?} {:?} {}", row.sides, row.cone, row.dim).to_lowercase();
        let (pair, links) = (&tables.pairs[row.pair as usize], [row.link, row.other]);
        match part.op.family() {
            Family::Kind | Family::Whitened if row.sides != Sides::Apart => kind,
            Family::Law => {
                let law = match (pair.impedance.flat, pair.impedance.small_power) {
                    (true, _) => "flat".to_owned(),
                    (_, power) => format!("power {power}"),
                };
                format!("{kind}, {law}, pair {}", row.pair)
            }
            _ => format!("{kind}, links {} {}", pair.link1, links[0]),
        }
    }
}

impl<T: Float> ModelCode<T> {
    /// Nothing compiled yet.
    ///
    /// # Errors
    ///
    /// If this machine cannot run code of the instruction set, or the system does not allow new code.
    pub fn new(tables: &Arc<Tables<T>>, isa: InstructionSet) -> Result<Self, CompileError> {
        isa.check()?;
        let code = Self::varying(tables, Quantities::NONE, Arc::new(Common::new(tables, isa)), None);
        // Whether the system lets new code run shows at the first piece, however small.
        let mut least = Recording::<T>::new();
        let mask = least.mask_input();
        least.mask_output(mask);
        least.finish().compile(isa)?;
        Ok(code)
    }

    fn varying(
        tables: &Arc<Tables<T>>,
        set: Quantities,
        common: Arc<Common<T>>,
        patterns: Option<Arc<Patterns<T>>>,
    ) -> Self {
        let slots = || (0..common.count()).map(|_| OnceLock::new());
        let reads = (0..common.count()).map(|_| OnceLock::new()).collect();
        let patterns = patterns.unwrap_or_else(|| Arc::new(Patterns::new(tables)));
        let (tables, slots) = (tables.clone(), slots().collect());
        ModelCode { tables, set, slots, reads, structure: OnceLock::new(), patterns, solves: OnceLock::new(), common }
    }

    /// The code for a set of quantities that vary; `tables` is the model whose structure allows for it. `self` is that for none.
    pub fn for_set(self: &Arc<Self>, tables: &Arc<Tables<T>>, set: Quantities) -> Arc<ModelCode<T>> {
        if set.is_empty() {
            return self.clone();
        }
        let mut all = self.common.varying.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = all.iter().find(|known| known.set == set) {
            return known.clone();
        }
        let mut made = ModelCode::varying(tables, set, self.common.clone(), None);
        let factor = Part::of(Op::Polish, 1);
        if made.is_too_large(factor) || made.depends(factor).and(set).is_empty() {
            made.patterns = self.patterns.clone();
        }
        let made = Arc::new(made);
        all.push(made.clone());
        made
    }

    /// What varies of what a part depends on, whatever varies.
    fn depends(&self, part: Part) -> Quantities {
        let Some(number) = self.common.number(part) else { return Quantities::NONE };
        *self.reads[number].get_or_init(|| {
            let varying = Quantity::varying();
            let structure = structured(part.op).then(|| Structure::of(&self.tables, varying));
            let of_structure = structure.as_ref().map_or(Quantities::NONE, |structure| structure.reads);
            let item = self.common.item(part);
            let subject = Subject {
                tables: &self.tables,
                set: varying,
                structure: structure.as_ref(),
                pattern: None,
                groups: &self.common.groups,
            };
            record(part, &item, &subject).map_or(varying, |recorded| recorded.reads).or(of_structure)
        })
    }

    /// The code of a part, if it can be had.
    #[inline]
    pub fn get(self: &Arc<Self>, root: &Arc<Self>, part: Part) -> Option<&Coded<T>> {
        let number = self.common.number(part)?;
        self.slots[number].get_or_init(|| self.find(root, part, number)).as_deref()
    }

    /// Makes the code of a part ready as a call of a session.
    #[cold]
    pub fn bind(self: &Arc<Self>, root: &Arc<Self>, part: Part, session: &mut Session<'_, T>, call: usize) {
        if let Some(coded) = self.get(root, part) {
            coded.bind(session, call);
        }
    }

    /// The code of a part: that of another set, if the part depends on nothing in which the sets differ, or new.
    #[cold]
    fn find(self: &Arc<Self>, root: &Arc<Self>, part: Part, number: usize) -> Option<Arc<Coded<T>>> {
        if !self.set.is_empty() {
            let depends = self.depends(part);
            if depends.and(self.set).is_empty() {
                root.get(root, part)?;
                return root.slots[number].get().cloned().flatten();
            }
            let others = self.common.varying.lock().unwrap_or_else(PoisonError::into_inner);
            let alike = |other: &&Arc<Self>| other.set.and(depends) == self.set.and(depends) && other.set != self.set;
            if let Some(known) = others.iter().filter(alike).find_map(|other| other.slots[number].get()) {
                return known.clone();
            }
        }
        if self.is_too_large(part) {
            return None;
        }
        let pattern = (part.of == 1).then(|| solver::fullest_pattern(&self.tables)).flatten();
        self.compile(part, self.record(part, pattern.as_ref())?).ok().map(Arc::new)
    }

    /// Whether a part for the block as a whole is not worth recording.
    fn is_too_large(&self, part: Part) -> bool {
        let sizes = &self.tables.sizes;
        let whole = matches!(part.op.family(), Family::Options(_)) && part.op != Op::Joints;
        whole && sizes.nm + 20 * sizes.nlink > MOST_OPERATIONS
    }

    fn record(&self, part: Part, pattern: Option<&Pattern>) -> Option<Recorded<T>> {
        let structure = self.structure_of(part.op);
        let subject = Subject { tables: &self.tables, set: self.set, structure, pattern, groups: &self.common.groups };
        record(part, &self.common.item(part), &subject)
    }

    fn compile(&self, part: Part, Recorded { program, sources, .. }: Recorded<T>) -> Result<Coded<T>, CompileError> {
        let isa = self.common.isa;
        let columns: Vec<_> = sources.iter().map(|source| source.column).collect();
        let fragment = match self.common.columns(part) {
            0 => program.compile(isa),
            KIND_COLUMNS => program.compile_each::<KIND_COLUMNS>(isa, &columns),
            _ => program.compile_each::<COLUMNS>(isa, &columns),
        }?;
        let set = sources.iter().fold(Threes::default(), |set, source| set.with(source.field));
        Ok(Coded { fragment: fragment.named(&self.common.name(&self.tables, part)), sources, set })
    }

    /// The code of a part on a filled pattern.
    pub fn on_pattern(&self, part: Part, pattern: &Pattern) -> Option<Coded<T>> {
        self.compile(part, self.record(part, Some(pattern))?).ok()
    }

    /// The instruction set.
    pub fn isa(&self) -> InstructionSet {
        self.common.isa
    }

    /// What parts of an op leave out as it is the same in all worlds.
    pub fn structure_of(&self, op: Op) -> Option<&Structure<T>> {
        structured(op).then(|| self.structure())
    }

    fn structure(&self) -> &Structure<T> {
        self.structure.get_or_init(|| Structure::of(&self.tables, self.set))
    }

    /// The parts that a plain step of the model may run.
    pub fn wanted(&self) -> impl Iterator<Item = Part> {
        let tables = &*self.tables;
        let pairs = |has: &dyn Fn(&lanesim_kernels::model::Pair<T>) -> bool| tables.pairs.iter().any(has);
        let both = pairs(&|pair| pair.sides != Sides::One);
        let listed = tables.equalities.iter().any(|equality| equality.cross) || tables.tendon_joins().next().is_some();
        let joins = tables.tiles.is_empty() && tables.own.is_empty() && (listed || pairs(&|pair| pair.cross));
        let primal = tables.options.solver != options::Solver::Pgs;
        let newton = tables.options.solver == options::Solver::Newton;
        let noslip = tables.options.noslip_iterations > 0;
        // Histories take what sensors measure at every step.
        let measures = !tables.sensor_rings.is_empty() && tables.options.flags.sensor;
        let wanted = move |part: &Part| match (part.op, part.of) {
            (Op::Smooth, of) => of == if kick::kicks(tables) { KICKED } else { 0 } + if measures { 2 } else { 0 },
            (Op::Integrate, _) => tables.options.integrator != Integrator::Rk4,
            (Op::Sensor, _) => measures,
            (Op::Energy | Op::MeasureBoth | Op::Couple, _) => false,
            (Op::Equality | Op::Joints | Op::Near | Op::Narrow | Op::Parallel | Op::Measure, _) => true,
            (Op::Combine, _) => true,
            (Op::Sweep, of) => {
                if of == 1 {
                    noslip
                } else {
                    !primal
                }
            }
            (Op::Push, _) => !primal,
            (Op::Hold, _) => noslip,
            (Op::Conjugate, _) => primal && !newton,
            (Op::Turn, _) => primal && newton,
            (Op::Curve | Op::Stiffen, _) if !newton => false,
            (Op::Spread | Op::Aim | Op::Motion | Op::Settle, _) => true,
            // Those of tiles are made when they are met.
            (op, _) if matches!(op.family(), Family::Tiles(_) | Family::Patches) => false,
            (Op::Curve, _) => primal && (both || listed),
            (Op::Descend, 0) => primal && newton && both,
            (Op::Descend, _) => primal && newton && joins,
            (Op::Polish, filled) => primal && newton && (joins || filled == 0),
            (Op::Survey | Op::Take | Op::Approach | Op::Slope | Op::Act | Op::Stiffen, kind) => {
                let sides = self.common.rows.kinds[kind as usize].sides;
                primal && sides != Sides::Apart
            }
            _ => primal,
        };
        Op::ALL.iter().flat_map(|op| self.common.parts(*op)).filter(wanted)
    }

    /// The fields that parts of a solve have to do with, if all have code but for those of single pairs and of filled patterns.
    #[inline]
    pub fn solves(self: &Arc<Self>, root: &Arc<Self>) -> Option<Threes> {
        *self.solves.get_or_init(|| {
            let filled = |part: &Part| matches!(part.op, Op::Descend | Op::Polish) && part.of == 1;
            let swept = |part: &Part| matches!(part.op, Op::Sweep | Op::Push | Op::Hold);
            let of_solve = |part: &Part| part.op.stage() == Stage::Solver && !filled(part) && !swept(part);
            let set = |part| self.get(root, part).map(|coded| coded.set);
            let mut fields = Threes::NONE;
            for part in self.wanted().filter(of_solve) {
                fields = fields.or(set(part)?);
            }
            // Of tiles, too, some stand for all.
            let of_tiles = Work::ALL.into_iter().map(Op::from);
            for code in of_tiles.filter_map(|op| self.common.parts(op).next()).map(set) {
                fields = fields.or(code?);
            }
            // Of those of single pairs, some stand for all.
            let Classes { couples, kinds, .. } = &self.common.rows;
            for sides in [Sides::Two, Sides::Apart] {
                let first = |rows: &[ContactRow]| rows.iter().copied().find(|row| row.sides == sides);
                let couple = (Op::Couple, first(couples));
                let of_kind = KIND_OPS.map(|op| (op, first(kinds)));
                for (op, row) in of_kind.into_iter().chain([couple]) {
                    let code = row.and_then(|row| set(row.part(op)));
                    fields = fields.or(code.unwrap_or_default());
                }
            }
            Some(fields)
        })
    }

    /// Lends fields to a session, and the list of contacts.
    #[inline(never)]
    pub fn lend<'a>(
        self: &'a Arc<Self>,
        set: Threes,
        (scratch, step): (&'a mut Scratch, &'a mut Step<'_, T::Block>),
        rows: &mut &'a [ContactRow],
    ) -> Session<'a, T> {
        let mut lending = Lending::new(scratch, self);
        let shared = |field: usize| self.common.shared.get(field.checked_sub(Group::Shared.first())?);
        *rows = step.lend(set, &mut |field, _, lanes| {
            let lent = match lanes {
                Lanes::Write(lanes) => FieldSlice::write(lanes),
                Lanes::Read(lanes) => shared(field).map_or_else(|| FieldSlice::read(lanes), |x| FieldSlice::uniform(x)),
            };
            lending.lend(field, lent);
        });
        lending.finish()
    }

    /// Makes the code that a plain step runs, and names it; `None`: that part stays with the kernels.
    pub fn all(self: &Arc<Self>) -> Vec<(String, Option<&Fragment<T>>)> {
        let code = |part| (self.common.name(&self.tables, part), self.get(self, part).map(|coded| &coded.fragment));
        self.wanted().map(code).collect()
    }
}

/// Parts of contacts by kind that contacts of all kinds have.
pub const KIND_OPS: [Op; 5] = [Op::Survey, Op::Take, Op::Approach, Op::Slope, Op::Act];

/// Of every shape, a tile that some work may be for, and whether there are such.
fn tiles_of<T>(tables: &Tables<T>, work: Work) -> Vec<(Tile, bool)> {
    let (tiles, count) = (&tables.tiles, work.strips());
    if tiles.is_empty() || work == Work::Couple {
        return vec![];
    }
    let of = |shape| (solver::prototype(tiles, work, shape), tiles.has(&tiles.lens_of(shape, count)));
    (0..tiles.lens.len().pow(count as u32) as u32).map(of).collect()
}

/// Whether a part's code leaves out what is the same in all worlds: those that come after the inertia matrix.
fn structured(op: Op) -> bool {
    op.stage() == Stage::Solver || matches!(op, Op::Measure | Op::MeasureBoth)
}
