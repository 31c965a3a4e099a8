//! Code for contacts with sides in one tree, by kind of contact.

use std::sync::OnceLock;

use lanesim_codegen::{Float, Fragment, InstructionSet, Program, Recorder, Recording, Windows, WindowsList};
use lanesim_kernels::code::ContactPart;
use lanesim_kernels::constraint::{Constraint, ContactRow, Kind, Law, Strength};
use lanesim_kernels::lane::Lane;
use lanesim_kernels::math::spatial::{Spatial, Sym6};
use lanesim_kernels::math::vec3::sub;
use lanesim_kernels::model::{NONE, Sides};
use lanesim_kernels::solver::Line;
use lanesim_kernels::solver::contact;
use lanesim_kernels::solver::edges;

use super::fields::Field;

/// All parts, with their names.
pub const ALL: [(ContactPart, &str); 6] = [
    (ContactPart::Survey, "survey"),
    (ContactPart::Choose, "choose"),
    (ContactPart::Approach, "approach"),
    (ContactPart::Slope, "slope"),
    (ContactPart::Act, "act"),
    (ContactPart::Stiffen, "stiffen"),
];

/// Place of a part in the list of all.
pub fn number(part: ContactPart) -> usize {
    part as usize
}

/// Whether contacts of the kind have the part.
pub fn applies(part: ContactPart, kind: Kind) -> bool {
    part != ContactPart::Stiffen || kind.sides == Sides::One
}

/// Number of kinds: a contact has 1 to 6 components, with one of three cones, and one or two sides that move.
const KINDS: usize = 2 * 3 * 6;

/// Code of the parts of all kinds, made at first use.
pub struct ContactCode<T>([[OnceLock<Option<Fragment<T>>>; KINDS]; ALL.len()]);

impl<T> Default for ContactCode<T> {
    fn default() -> Self {
        ContactCode(std::array::from_fn(|_| std::array::from_fn(|_| OnceLock::new())))
    }
}

impl<T: Float> ContactCode<T> {
    /// The code of a part, unless it cannot be had. `live` says which components motions of links can have.
    pub fn get(&self, part: ContactPart, kind: Kind, live: [bool; 6], isa: InstructionSet) -> Option<&Fragment<T>> {
        let sides = usize::from(kind.sides != Sides::One);
        let place = &self.0[part as usize][18 * sides + 6 * kind.cone as usize + kind.dim as usize - 1];
        let compile = || {
            let columns: Vec<_> = fields(part).iter().map(|(_, column)| column.map(|c| c as usize)).collect();
            let code = record(part, kind, live).compile_each::<COLUMNS>(isa, &columns).ok()?;
            Some(code.named(&format!("{part:?} {:?}", kind.sides)))
        };
        place.get_or_init(compile).as_ref()
    }
}

/// Where a contact has its numbers in the block's arrays: what windows are there of.
#[derive(Clone, Copy, Debug)]
pub enum Column {
    Strength,
    /// Motion rows, of six numbers for a component.
    Motion,
    Component,
    /// Of six numbers for a link: motions, and forces.
    Link,
    /// The same of the other side's link.
    Other,
    Stiffness,
}

/// Number of columns.
pub const COLUMNS: usize = 6;

/// Windows of a block's contacts: of every kind a list of all, then of every kind one of those that act in some world that
/// still iterates.
#[derive(Default)]
pub struct Places {
    windows: Windows<COLUMNS>,
    /// Numbers of the kinds that there are contacts of.
    present: Vec<usize>,
    kinds: usize,
    /// Worlds in which the contacts act, list by list; of the second lists once there are any.
    lanes: Vec<u32>,
    /// Where those of a list start, and their number.
    extents: Vec<(usize, usize)>,
    /// Worlds for which the second lists were made; `None`: they were not yet.
    open: Option<u32>,
    /// Contacts with a stored Jacobian, and the windows of each in a list of its own, by [`COUPLE`].
    couplings: Vec<Coupling>,
    coupled: Windows<COUPLED>,
}

/// A contact whose sides both move.
#[derive(Clone, Copy, Debug)]
pub struct Coupling {
    pub pair: u32,
    /// Worlds in which it acts.
    pub lanes: u32,
    /// Its entry in the list of strengths.
    strength: u32,
}

impl Places {
    /// Room for so many contacts.
    pub fn with_capacity(contacts: usize, kinds: usize) -> Self {
        Places {
            windows: Windows::with_capacity(2 * kinds, 2 * contacts),
            present: Vec::with_capacity(kinds),
            kinds,
            lanes: Vec::with_capacity(contacts),
            extents: Vec::with_capacity(kinds),
            open: None,
            couplings: Vec::with_capacity(contacts),
            coupled: Windows::with_capacity(contacts, contacts),
        }
    }

    /// Sets the windows of all contacts with sides in one tree.
    pub fn place<L: Lane>(&mut self, constraint: &Constraint<L>) {
        self.windows.clear();
        self.lanes.clear();
        self.extents.clear();
        self.present.clear();
        self.kinds = constraint.kinds.len();
        self.open = None;
        for kind in 0..self.kinds {
            let first = self.lanes.len();
            let rows = constraint.contact_rows.iter().filter(|row| row.number as usize == kind);
            self.windows.add(rows.map(|row| {
                self.lanes.push(row.lanes);
                starts(row)
            }));
            let len = self.lanes.len() - first;
            self.extents.push((first, len));
            if len != 0 {
                self.present.push(kind);
            }
        }
        self.couplings.clear();
        self.coupled.clear();
        let moving = constraint.contact_rows.iter().filter(|row| constraint.coupled && row.sides != Sides::One);
        for row in moving {
            self.couplings.push(Coupling { pair: row.pair, lanes: row.lanes, strength: row.strength });
            let places = [7 * row.strength, row.jacobian, row.component].map(|x| x as usize);
            self.coupled.add(std::iter::once(places));
        }
    }

    /// Numbers of the kinds that there are contacts of.
    #[inline(always)]
    pub fn present(&self) -> &[usize] {
        &self.present
    }

    /// All contacts of a kind.
    #[inline(always)]
    pub fn all(&self, kind: usize) -> Run<'_> {
        self.windows.list(kind)
    }

    /// Those that act in some world that still iterates, after [`narrow`](Places::narrow).
    #[inline(always)]
    pub fn active(&self, kind: usize) -> Run<'_> {
        self.windows.list(self.kinds + kind)
    }

    /// Contacts with a stored Jacobian.
    #[inline(always)]
    pub fn couplings(&self) -> &[Coupling] {
        &self.couplings
    }

    /// The windows of one of these, by [`COUPLE`].
    #[inline(always)]
    pub fn coupling(&self, number: usize) -> WindowsList<'_, COUPLED> {
        self.coupled.list(number)
    }

    /// The number of a contact among these.
    pub fn coupling_of(&self, row: &ContactRow) -> Option<usize> {
        self.couplings.iter().position(|coupling| coupling.strength == row.strength)
    }

    /// Leaves the contacts in the second lists that act in some world of `open`, which are fewer from call to call.
    pub fn narrow(&mut self, open: u32) {
        if self.open == Some(open) {
            return;
        }
        if self.open.replace(open).is_none() {
            self.windows.repeat();
        }
        for kind in &self.present {
            let (first, len) = &mut self.extents[*kind];
            let lanes = &mut self.lanes[*first..*first + *len];
            let mut kept = 0;
            self.windows.retain(self.kinds + kind, |item| {
                let keep = lanes[item] & open != 0;
                if keep {
                    lanes[kept] = lanes[item];
                    kept += 1;
                }
                keep
            });
            *len = kept;
        }
    }
}

/// Windows of contacts of a kind.
pub type Run<'a> = WindowsList<'a, COLUMNS>;

/// Where the windows of a contact start, by [`Column`].
fn starts(row: &ContactRow) -> [usize; COLUMNS] {
    let other = if row.other == NONE { 0 } else { row.other };
    let [strength, component, link, other] = [row.strength, row.component, row.link, other].map(|x| x as usize);
    [7 * strength, 6 * component, component, 6 * link, 6 * other, 21 * link]
}

/// The fields of the code that adds a contact to the Hessian, with their columns: see [`solver::couple`](super::solver::couple).
pub const COUPLE: [(Field, Option<usize>); 4] =
    [(Field::Strengths, Some(0)), (Field::Jacobian, Some(1)), (Field::Y, Some(2)), (Field::Hessian, None)];

/// Number of those columns.
pub const COUPLED: usize = 3;

/// Most fields of a part.
pub const MOST_FIELDS: usize = 10;

/// The fields of a part, with their windows. Of contacts with one moving side the other's are empty.
pub fn fields(part: ContactPart) -> &'static [(Field, Option<Column>)] {
    macro_rules! fields {
        ($($field:ident $column:expr),*) => { &[$((Field::$field, $column)),*] };
    }
    const STRENGTH: Option<Column> = Some(Column::Strength);
    const MOTION: Option<Column> = Some(Column::Motion);
    const COMPONENT: Option<Column> = Some(Column::Component);
    const LINK: Option<Column> = Some(Column::Link);
    const OTHER: Option<Column> = Some(Column::Other);
    const STIFFNESS: Option<Column> = Some(Column::Stiffness);
    match part {
        ContactPart::Survey => {
            fields!(Strengths STRENGTH, Motion MOTION, Y COMPONENT, ColdTwist LINK, ColdTwist OTHER,
            Twist LINK, Twist OTHER, Jp COMPONENT, Reference COMPONENT, Line None)
        }
        ContactPart::Choose => fields!(Y COMPONENT, Jp COMPONENT),
        ContactPart::Approach => fields!(Strengths STRENGTH, Motion MOTION, Y COMPONENT, Twist LINK, Twist OTHER,
            Jp COMPONENT, Line None),
        ContactPart::Slope => fields!(Strengths STRENGTH, Y COMPONENT, Jp COMPONENT, Line None),
        ContactPart::Act => fields!(Strengths STRENGTH, Motion MOTION, Y COMPONENT, Line None, Jp COMPONENT,
            Force COMPONENT, Wrench LINK, Wrench OTHER),
        ContactPart::Stiffen => fields!(Strengths STRENGTH, Motion MOTION, Y COMPONENT, Stiffness STIFFNESS),
    }
}

/// Number of masks that a part takes.
pub fn masks(part: ContactPart) -> usize {
    usize::from(matches!(part, ContactPart::Choose | ContactPart::Act))
}

/// A contact's fields, recorded one after the other.
struct Recorded<T: Float> {
    recording: Recording<T>,
    next: usize,
}

impl<T: Float> Recorded<T> {
    fn input<const N: usize>(&mut self) -> (usize, [Recorder<T>; N]) {
        let (field, lanes) = self.list(N);
        let mut out = [Recorder::zero(); N];
        out.copy_from_slice(&lanes);
        (field, out)
    }

    fn list(&mut self, len: usize) -> (usize, Vec<Recorder<T>>) {
        let field = self.next;
        self.next += 1;
        (field, self.recording.input(field, len))
    }

    fn line(&mut self) -> (usize, Line<Recorder<T>>) {
        let (field, line) = self.input();
        (field, Line(line))
    }
}

/// Sets components that no motion has to zero.
pub fn clear_dead<T: Float>(live: [bool; 6], spatial: &mut Spatial<Recorder<T>>) {
    for (x, _) in spatial.iter_mut().zip(live).filter(|(_, live)| !live) {
        *x = Recorder::zero();
    }
}

/// Puts back what components that no motion has were before: nobody reads them.
fn keep_dead<T: Float>(live: [bool; 6], changed: &mut Spatial<Recorder<T>>, before: &Spatial<Recorder<T>>) {
    for ((x, before), _) in changed.iter_mut().zip(before).zip(live).filter(|(_, live)| !live) {
        *x = *before;
    }
}

/// Records a part, on its [`fields`].
fn record<T: Float>(part: ContactPart, kind: Kind, live: [bool; 6]) -> Program<T> {
    let mut r = Recorded { recording: Recording::<T>::new(), next: 0 };
    let dim = kind.dim as usize;
    let other = if kind.sides == Sides::One { 0 } else { 6 };
    if part == ContactPart::Slope {
        let (_, strength): (_, Strength<Recorder<T>>) = r.input();
        let law = Law { cone: kind.cone, strength: &strength };
        let (_, y) = r.list(dim);
        let (_, jp) = r.list(dim);
        let (field, mut line) = r.line();
        edges::slope(law, &y, &jp, line.step(), &mut line);
        r.recording.output(field, &line.0);
        return r.recording.finish();
    }
    if part == ContactPart::Choose {
        let (field, mut y) = r.list(dim);
        let (_, cold) = r.list(dim);
        let warm = r.recording.mask_input();
        contact::choose(warm, &mut y, &cold);
        r.recording.output(field, &y);
        return r.recording.finish();
    }
    let (_, strength): (_, Strength<Recorder<T>>) = r.input();
    let law = Law { cone: kind.cone, strength: &strength };
    let (_, w) = r.list(6 * dim);
    let mut w: Vec<Spatial<_>> = w.as_chunks::<6>().0.to_vec();
    w.iter_mut().for_each(|w| clear_dead(live, w));
    let (y_field, mut y) = r.list(dim);
    let twist = |r: &mut Recorded<T>| {
        let (_, link): (_, Spatial<_>) = r.input();
        let (_, other) = r.list(other);
        let mut twist = other.first_chunk().map_or(link, |other| sub(&link, other));
        clear_dead(live, &mut twist);
        twist
    };
    match part {
        ContactPart::Survey => {
            let twists = [twist(&mut r), twist(&mut r)];
            let (cold_field, mut cold) = r.list(dim);
            let (_, reference) = r.list(dim);
            let (field, mut line) = r.line();
            contact::survey(law, &w, &twists, &reference, [&mut cold, &mut y], &mut line);
            r.recording.output(cold_field, &cold);
            r.recording.output(y_field, &y);
            r.recording.output(field, &line.0);
        }
        ContactPart::Approach => {
            let twist = twist(&mut r);
            let (jp_field, mut jp) = r.list(dim);
            let (field, mut line) = r.line();
            contact::approach(law, &w, &twist, &y, &mut jp, &mut line);
            r.recording.output(jp_field, &jp);
            r.recording.output(field, &line.0);
        }
        ContactPart::Act => {
            let (_, line) = r.line();
            let (_, jp) = r.list(dim);
            let (force_field, mut force) = r.list(dim);
            let (field, link): (_, Spatial<_>) = r.input();
            let (other_field, others) = r.list(other);
            let open = r.recording.mask_input();
            let mut wrench = link;
            let mut other: Option<Spatial<_>> = others.first_chunk().copied();
            contact::act(law, &w, line.step(), open, &jp, &mut y, &mut force, &mut wrench, other.as_mut());
            keep_dead(live, &mut wrench, &link);
            r.recording.output(y_field, &y);
            r.recording.output(force_field, &force);
            r.recording.output(field, &wrench);
            if let (Some(other), Some(before)) = (&mut other, others.first_chunk()) {
                keep_dead(live, other, before);
                r.recording.output(other_field, other);
            }
        }
        ContactPart::Stiffen => {
            let (field, before): (_, Sym6<_>) = r.input();
            let mut stiffness = before;
            contact::stiffen(law, &w, &y, &mut stiffness);
            for (entry, before) in before.iter().enumerate() {
                if Field::Stiffness.is_dead(entry, live) {
                    stiffness[entry] = *before;
                }
            }
            r.recording.output(field, &stiffness);
        }
        ContactPart::Slope | ContactPart::Choose => {}
    }
    r.recording.finish()
}
