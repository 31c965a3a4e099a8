//! Recording a part: its kernel once over a lane that writes down, with all fields of a step as inputs. What it reads of them,
//! and of what varies, is asked of what was recorded.

use lanesim_codegen::{Float, Program, Recorder, Recording};
use lanesim_kernels::lane::{Lane, Mask};
use lanesim_kernels::model::{Instance, Model, Pattern, Quantities, Quantity, Varied};
use lanesim_kernels::part::{Group, Item, Lanes, Name, Op, Part, Step};
use lanesim_kernels::solver::SolverWork;
use lanesim_kernels::stage::{Stage, Stages};
use lanesim_kernels::state::{Applied, State};
use lanesim_kernels::workspace::Workspace;

use super::structure::Structure;

/// Operations beyond which a part stays with the kernels: its code would not stay in a core's cache.
pub const MOST_OPERATIONS: usize = 80_000;

/// Where a field of a program is: its number in a step, and the column in which an item says where its window starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    pub field: usize,
    pub column: Option<usize>,
}

/// What was recorded of a part.
pub struct Recorded<T> {
    pub program: Program<T>,
    /// Its fields, in ascending order.
    pub sources: Vec<Source>,
    /// What it reads of what varies.
    pub reads: Quantities,
}

/// What is recorded, for which model.
pub struct Subject<'a, T: Float> {
    pub tables: &'a Model<T>,
    /// What varies.
    pub set: Quantities,
    /// What is the same in all worlds, for parts that come after the inertia matrix.
    pub structure: Option<&'a Structure<T>>,
    /// The filled pattern of the Hessian.
    pub pattern: Option<&'a Pattern>,
    /// Groups of pairs.
    pub groups: &'a [Vec<u32>],
}

/// Windows into one field, at most: numbers of a program's fields are those of a step times so many.
const WINDOWS: usize = lanesim_kernels::part::WINDOWS;

/// Binds the fields of a step to a recording.
struct Binder<'a, T: Float> {
    recording: Recording<T>,
    subject: &'a Subject<'a, T>,
    item: &'a Item<'a>,
    /// Where the item's windows start.
    starts: [usize; lanesim_kernels::part::COLUMNS],
    sources: Vec<Option<Source>>,
}

impl<T: Float> Binder<'_, T> {
    /// Calls `f` with what the part sees of a field: number in the program, first entry and number of entries.
    fn each(
        &mut self,
        field: usize,
        name: Name,
        len: usize,
        mut f: impl FnMut(&mut Recording<T>, usize, usize, usize),
    ) {
        if len == 0 {
            return;
        }
        let windows = self.item.windows(self.subject.tables, name);
        let mut see = |window: usize, column: Option<usize>, start: usize, len: usize| {
            let number = WINDOWS * field + window;
            if self.sources.len() <= number {
                self.sources.resize(number + 1, None);
            }
            self.sources[number] = Some(Source { field, column });
            f(&mut self.recording, number, start, len);
        };
        if windows.is_empty() {
            see(0, None, 0, len);
        }
        for (window, (column, len)) in windows.into_iter().enumerate() {
            see(window, Some(column), self.starts[column], len);
        }
    }

    /// Makes the lanes inputs: all of the field, or the item's windows, beside which nothing is known.
    fn input(&mut self, field: usize, name: Name, lanes: &mut [Recorder<T>]) {
        let (unknown, structure) = (self.recording.unknown(), self.subject.structure);
        let len = lanes.len();
        lanes.fill(unknown);
        self.each(field, name, len, |recording, number, start, len| {
            lanes[start..start + len].copy_from_slice(&recording.input(number, len));
        });
        // Windows may be of other dofs, of which other entries are known.
        let windows = name == ["position", "cdof"] && !self.item.windows(self.subject.tables, name).is_empty();
        if let (Some(structure), false) = (structure, windows) {
            structure.fill_in(name, lanes);
        }
    }

    /// Numbers that vary, and those that all worlds share.
    fn varied(&mut self, shared: Quantities, varied: &mut Varied<Recorder<T>>) {
        for quantity in varied.set().iter() {
            let (field, name) = (Group::Varied.first() + quantity as usize, ["varied", quantity.name()]);
            let lanes = varied.lanes_mut(quantity);
            if !shared.has(quantity) {
                self.input(field, name, lanes);
                continue;
            }
            self.each(field, name, lanes.len(), |recording, number, start, len| {
                lanes[start..start + len].copy_from_slice(&recording.uniform(number, len));
            });
        }
    }

    /// Makes the lanes what the field shall hold. What nobody reads stays as it was.
    fn output(&mut self, field: usize, name: Name, lanes: &mut [Recorder<T>]) {
        let structure = self.subject.structure;
        self.each(field, name, lanes.len(), |recording, number, start, len| {
            let lanes = &mut lanes[start..start + len];
            let before = recording.input(number, len);
            if let Some(structure) = structure {
                let dead = (0..len).filter(|entry| structure.is_dead(name, start + entry));
                dead.for_each(|entry| lanes[entry] = before[entry]);
            }
            recording.output(number, lanes);
        });
    }
}

/// Records a part; `None`: it would be too large.
pub fn record<T: Float>(part: Part, item: &Item<'_>, subject: &Subject<'_, T>) -> Option<Recorded<T>> {
    let Subject { tables, set, .. } = *subject;
    let shared = part.op.shared();
    let starts = item.starts(tables, 1);
    let mut binder =
        Binder { recording: Recording::with_limit(MOST_OPERATIONS), subject, item, starts, sources: vec![] };
    let mut varied = Varied::new(tables, set.or(shared));
    binder.varied(shared, &mut varied);
    let mut applied = (part.op == Op::Smooth && part.of & 1 != 0).then(|| Applied::new(&tables.sizes));
    if let Some(applied) = &mut applied {
        let mut field = Group::Applied.first();
        applied.for_each(&mut |view| {
            binder.input(field, ["applied", view.name], view.data);
            field += 1;
        });
    }
    let mut state = State::new(&tables.sizes);
    let mut ws = workspace(tables, item, subject.groups, subject.pattern);
    let model = Instance { model: tables, varied: Some(&varied) };
    let stages = Stages::STEP | Stages::up_to(Stage::Energy);
    let mut step = Step { model, state: &mut state, applied: applied.as_ref(), ws: &mut ws, stages, clock: None };
    step.lend_all(&mut |field, name, lanes| {
        if let Lanes::Write(lanes) = lanes {
            binder.input(field, name, lanes);
        }
    });
    let given = if part.op.masks()[0] > 0 { binder.recording.mask_input() } else { Mask::splat(false) };
    let mut returned = vec![];
    part.run(item, given, &mut |mask| returned.push(mask), &mut step);
    let changes = part.changes(tables);
    step.lend_all(&mut |field, name, lanes| {
        let changed = |change: &&str| *change == name[0] || change.split_once('.') == Some((name[0], name[1]));
        if let (Lanes::Write(lanes), true) = (lanes, changes.iter().any(changed)) {
            binder.output(field, name, lanes);
        }
    });
    for mask in returned {
        binder.recording.mask_output(mask);
    }
    let mut program = binder.recording.finish();
    if program.is_too_large() {
        return None;
    }
    let uses = program.uses();
    program.renumber(&uses);
    let sources: Vec<Source> = uses.iter().filter_map(|number| binder.sources[*number]).collect();
    let read = |quantity: &Quantity| {
        let field = Group::Varied.first() + *quantity as usize;
        set.has(*quantity) && sources.iter().any(|source| source.field == field)
    };
    let reads: Vec<Quantity> = Quantity::ALL.into_iter().filter(read).collect();
    Some(Recorded { program, reads: Quantities::of(&reads), sources })
}

/// A workspace with one item, all rows on joints, and the filled pattern.
pub fn workspace<L: Lane>(
    tables: &Model<L::Real>,
    item: &Item<'_>,
    groups: &[Vec<u32>],
    pattern: Option<&Pattern>,
) -> Workspace<L> {
    let zero = L::zero();
    let mut ws = Workspace::without_groups(tables);
    ws.collision.groups = groups.to_vec();
    let mut places = 0;
    match item {
        Item::Whole => {}
        Item::Near(near) => places = near.points as usize,
        Item::Tile(_) => {}
        Item::Row(row) | Item::Patch(row, _) | Item::Whitened(row, _) => {
            places = 1;
            let (constraint, dim) = (&mut ws.constraint, row.dim as usize);
            let dofs = tables.pairs[row.pair as usize].dofs.len as usize;
            constraint.strengths.resize(1, [zero; 7]);
            constraint.reference.resize(dim, zero);
            constraint.motion.resize(dim, [zero; 6]);
            constraint.jacobian.resize(dim * dofs, zero);
            constraint.components = dim;
            constraint.contact_rows.push(**row);
        }
    }
    ws.collision.found.resize(places, [zero; 13]);
    ws.collision.parallel.resize(places, zero);
    ws.solver.fit(&ws.constraint);
    if let Item::Whitened(row, place) = item {
        let SolverWork { dual, edge_force, .. } = &mut ws.solver;
        dual.contacts.resize(place.end(row) as usize, zero);
        edge_force.resize(row.edges(), zero);
    }
    ws.solver.touched.fill(true);
    ws.solver.fill.pattern = pattern.unwrap_or(&tables.tree_pattern).clone();
    ws
}
