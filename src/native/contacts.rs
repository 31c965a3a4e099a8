//! Code for contacts with one moving side, by kind of contact.

use std::sync::OnceLock;

use lanesim_codegen::{
    FieldSlice, Float, Fragment, InstructionSet, Program, Recorder, Recording, Scratch, Windows, WindowsList,
};
use lanesim_kernels::constraint::{Cone, Constraint, ContactRow, Law, Strength, cone};
use lanesim_kernels::lane::Lane;
use lanesim_kernels::math::spatial::Spatial;
use lanesim_kernels::model::{Model, NONE};
use lanesim_kernels::solver::contact::{self, Contacts, Kind, Sym6};
use lanesim_kernels::solver::edges::{EDGE, ELLIPSE, Edges};

/// What is done with a contact, after the kernels of the same names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactPart {
    Survey,
    Approach,
    Act,
    Stiffen,
}

impl ContactPart {
    /// All parts, with their names.
    pub const ALL: [(ContactPart, &str); PARTS] = [
        (ContactPart::Survey, "survey"),
        (ContactPart::Approach, "approach"),
        (ContactPart::Act, "act"),
        (ContactPart::Stiffen, "stiffen"),
    ];
}

/// The kinds of the contacts with one moving side that the model can have.
pub fn kinds<T>(model: &Model<T>) -> Vec<Kind> {
    let mut kinds = Vec::new();
    for pair in model.pairs.iter().filter(|pair| pair.link1 == NONE || pair.link2 == NONE) {
        let kind = Kind { cone: cone(model, pair), dim: pair.condim };
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    kinds
}

/// Number of parts.
const PARTS: usize = 4;
/// Number of kinds: a contact has 1 to 6 components, with one of three cones.
const KINDS: usize = 3 * 6;

/// Code of the parts of all kinds, made at first use.
pub struct ContactCode<T>([[OnceLock<Option<Fragment<T>>>; KINDS]; PARTS]);

impl<T> Default for ContactCode<T> {
    fn default() -> Self {
        ContactCode(std::array::from_fn(|_| std::array::from_fn(|_| OnceLock::new())))
    }
}

impl<T: Float> ContactCode<T> {
    /// The code of a part, unless it cannot be had.
    pub fn get(&self, part: ContactPart, kind: Kind, isa: InstructionSet) -> Option<&Fragment<T>> {
        let place = &self.0[part as usize][6 * kind.cone as usize + kind.dim as usize - 1];
        let compile = || {
            let (program, columns) = record(part, kind);
            program.compile_each::<COLUMNS>(isa, &columns).ok()
        };
        place.get_or_init(compile).as_ref()
    }
}

/// Where a contact has its numbers in the block's arrays: what windows are there of.
#[derive(Clone, Copy, Debug)]
enum Column {
    Strength,
    /// Motion rows, of six numbers for a component.
    Motion,
    Component,
    Edge,
    /// Of six numbers for a link: motions, and forces.
    Link,
    Stiffness,
}

/// Number of columns.
const COLUMNS: usize = 6;

/// Windows of a block's contacts, run by run.
pub type Places = Windows<COLUMNS>;
/// Windows of a run of contacts.
pub type Run<'a> = WindowsList<'a, COLUMNS>;

/// Where the windows of a contact start, by [`Column`].
fn starts(row: &ContactRow) -> [usize; COLUMNS] {
    let [strength, component, edge, link] = [row.strength, row.component, row.edge, row.link].map(|x| x as usize);
    let width = if row.cone == Cone::Ellipse { ELLIPSE } else { EDGE };
    [7 * strength, 6 * component, component, width * edge, 6 * link, 21 * link]
}

/// Sets the windows of all contacts with one moving side.
pub fn place<L: Lane>(constraint: &Constraint<L>, places: &mut Places) {
    places.clear();
    for contacts in Contacts::runs(constraint) {
        places.begin();
        contacts.rows().for_each(|row| places.push(starts(row)));
    }
}

/// The windows of a run, which are those that [`place`] has set for the list it is from.
#[inline]
pub fn windows<'a>(places: &'a Places, contacts: Contacts<'_>) -> Run<'a> {
    let windows = places.list(contacts.number);
    debug_assert_eq!(windows.len(), contacts.rows().count(), "the solve did not begin with these contacts");
    windows
}

/// A contact's fields, recorded, and the windows that they are.
struct Recorded<T: Float> {
    recording: Recording<T>,
    columns: Vec<Option<usize>>,
}

impl<T: Float> Recorded<T> {
    fn input<const N: usize>(&mut self, column: Option<Column>) -> (usize, [Recorder<T>; N]) {
        let (field, lanes) = self.list(column, N);
        let mut out = [Recorder::zero(); N];
        out.copy_from_slice(&lanes);
        (field, out)
    }

    fn list(&mut self, column: Option<Column>, len: usize) -> (usize, Vec<Recorder<T>>) {
        let field = self.columns.len();
        self.columns.push(column.map(|column| column as usize));
        (field, self.recording.input(field, len))
    }
}

/// Fields: strength, motion rows, y; then what the part's kernel reads and writes, in its order. With their columns.
fn record<T: Float>(part: ContactPart, kind: Kind) -> (Program<T>, Vec<Option<usize>>) {
    use Column::{Component, Edge, Link, Motion, Stiffness};
    let mut r = Recorded { recording: Recording::<T>::new(), columns: vec![] };
    let dim = kind.dim as usize;
    let (_, strength): (_, Strength<Recorder<T>>) = r.input(Some(Column::Strength));
    let law = Law { cone: kind.cone, strength: &strength };
    let (_, w) = r.list(Some(Motion), 6 * dim);
    let (w, _) = w.as_chunks::<6>();
    let (y_field, mut y) = r.list(Some(Component), dim);
    match part {
        ContactPart::Survey => {
            let (_, twist): (_, Spatial<_>) = r.input(Some(Link));
            let (_, reference) = r.list(Some(Component), dim);
            let (field, [mut twice]) = r.input(None);
            contact::survey(law, w, &twist, &reference, &mut y, &mut twice);
            r.recording.output(y_field, &y);
            r.recording.output(field, &[twice]);
        }
        ContactPart::Approach => {
            let (_, twist): (_, Spatial<_>) = r.input(Some(Link));
            let (jp_field, mut jp) = r.list(Some(Component), dim);
            let (edges_field, mut edges) = r.list(Some(Edge), numbers(kind));
            let (field, [mut same]) = r.input(None);
            contact::approach(law, w, &twist, &y, &mut jp, &mut edges, &mut same);
            r.recording.output(jp_field, &jp);
            r.recording.output(edges_field, &edges);
            r.recording.output(field, &[same]);
        }
        ContactPart::Act => {
            let (_, [step]) = r.input(None);
            let (_, jp) = r.list(Some(Component), dim);
            let (force_field, mut force) = r.list(Some(Component), dim);
            let (field, mut wrench): (_, Spatial<_>) = r.input(Some(Link));
            let open = r.recording.mask_input();
            contact::act(law, w, step, open, &jp, &mut y, &mut force, &mut wrench);
            r.recording.output(y_field, &y);
            r.recording.output(force_field, &force);
            r.recording.output(field, &wrench);
        }
        ContactPart::Stiffen => {
            let (field, mut stiffness): (_, Sym6<_>) = r.input(Some(Stiffness));
            contact::stiffen(law, w, &y, &mut stiffness);
            r.recording.output(field, &stiffness);
        }
    }
    (r.recording.finish(), r.columns)
}

/// Numbers that the line search has of a contact.
fn numbers(kind: Kind) -> usize {
    match kind.cone {
        Cone::Ray => EDGE,
        Cone::Pyramid => 2 * (kind.dim as usize - 1) * EDGE,
        Cone::Ellipse => ELLIPSE,
    }
}

fn lent<'a, T: Float>(constraint: &'a Constraint<T::Block>) -> [FieldSlice<'a, T>; 2] {
    let strengths = FieldSlice::read(constraint.strengths.as_flattened());
    [strengths, FieldSlice::read(constraint.motion.as_flattened())]
}

/// Runs the code of [`ContactPart::Survey`].
pub fn survey<T: Float>(
    fragment: &Fragment<T>,
    scratch: &mut Scratch,
    constraint: &Constraint<T::Block>,
    windows: Run<'_>,
    twist: &[[T::Block; 6]],
    y: &mut [T::Block],
    twice: &mut [T::Block; 1],
) {
    let [strengths, motion] = lent(constraint);
    let (twist, reference) = (FieldSlice::read(twist.as_flattened()), FieldSlice::read(&constraint.reference));
    let mut fields = [strengths, motion, FieldSlice::write(y), twist, reference, FieldSlice::write(twice)];
    fragment.run_each(scratch, &mut fields, &[], windows);
}

/// Runs the code of [`ContactPart::Approach`].
#[allow(clippy::too_many_arguments)] // all that contacts have
pub fn approach<T: Float>(
    fragment: &Fragment<T>,
    scratch: &mut Scratch,
    constraint: &Constraint<T::Block>,
    (cone, windows): (Cone, Run<'_>),
    twist: &[[T::Block; 6]],
    y: &[T::Block],
    jp: &mut [T::Block],
    edges: &mut Edges<T::Block>,
) {
    let [strengths, motion] = lent(constraint);
    let list = match cone {
        Cone::Ray | Cone::Pyramid => edges.contacts.as_flattened_mut(),
        Cone::Ellipse => edges.ellipses.as_flattened_mut(),
    };
    let (twist, y, jp) = (FieldSlice::read(twist.as_flattened()), FieldSlice::read(y), FieldSlice::write(jp));
    let (list, same) = (FieldSlice::write(list), FieldSlice::write(&mut edges.same));
    let mut fields = [strengths, motion, y, twist, jp, list, same];
    fragment.run_each(scratch, &mut fields, &[], windows);
}

/// Runs the code of [`ContactPart::Act`].
#[allow(clippy::too_many_arguments)] // all that contacts have
pub fn act<T: Float>(
    fragment: &Fragment<T>,
    scratch: &mut Scratch,
    constraint: &Constraint<T::Block>,
    windows: Run<'_>,
    (step, open): (T::Block, u32),
    jp: &[T::Block],
    y: &mut [T::Block],
    force: &mut [T::Block],
    wrench: &mut [[T::Block; 6]],
) {
    let [strengths, motion] = lent(constraint);
    let step = [step];
    let (step, jp, y) = (FieldSlice::read(&step), FieldSlice::read(jp), FieldSlice::write(y));
    let (force, wrench) = (FieldSlice::write(force), FieldSlice::write(wrench.as_flattened_mut()));
    let mut fields = [strengths, motion, y, step, jp, force, wrench];
    fragment.run_each(scratch, &mut fields, &[open], windows);
}

/// Runs the code of [`ContactPart::Stiffen`].
pub fn stiffen<T: Float>(
    fragment: &Fragment<T>,
    scratch: &mut Scratch,
    constraint: &Constraint<T::Block>,
    windows: Run<'_>,
    y: &[T::Block],
    stiffness: &mut [[T::Block; 21]],
) {
    let [strengths, motion] = lent(constraint);
    let stiffness = FieldSlice::write(stiffness.as_flattened_mut());
    let mut fields = [strengths, motion, FieldSlice::read(y), stiffness];
    fragment.run_each(scratch, &mut fields, &[], windows);
}
