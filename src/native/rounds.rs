//! Newton's iteration with all its parts in code, bound once for a solve.

use lanesim_codegen::{Block, Call, FieldSlice, Scratch, Session};
use lanesim_kernels::code::{ContactPart, SolverPart};
use lanesim_kernels::constraint::{ContactRow, Kind};
use lanesim_kernels::lane::Real;
use lanesim_kernels::model::Sides;
use lanesim_kernels::options;
use lanesim_kernels::solver::{Arrival, Problem, Rounds, SolverWork, Trial};

use super::contacts::{self, Places};
use super::fields::{self, Field, Table};
use super::patterns::{Found, Joined};
use super::{ModelCode, solver};

/// What the type says that holds them: parts for which there is no code are not bound.
const COMPILED: &str = "all parts have code";

/// The pattern of the factor at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Factor {
    /// That of the inertia matrix.
    Tree,
    /// A filled one, by its place.
    Filled(usize),
    /// The fullest.
    Full,
}

impl Factor {
    fn filled(self) -> bool {
        self != Factor::Tree
    }
}

/// The parts of an iteration, bound when they are first needed.
pub struct Bound<'a, L: Block> {
    code: &'a ModelCode<L::Float>,
    places: &'a mut Places,
    kinds: &'a [Kind],
    /// Contacts whose sides both move; empty: there are none.
    both: &'a [ContactRow],
    found: &'a mut Found,
    factor: Factor,
    /// Whether contacts are worked through that act only in worlds that no longer iterate.
    whole: bool,
    fields: Table<'a, L::Float>,
    session: Session<'a, L::Float>,
    /// By their place in [`solver::ALL`].
    parts: [Option<Call>; solver::ALL.len()],
    /// The first of one call for every kind of contact that is listed, by their place in [`contacts::ALL`].
    lists: [Option<Call>; contacts::ALL.len()],
    couplings: Option<Call>,
}

impl<'a, L: Block> Bound<'a, L> {
    /// Lends the fields; `None` unless all parts that the problem needs have code.
    pub fn new(
        code: &'a ModelCode<L::Float>,
        (scratch, places, found): (&'a mut Scratch, &'a mut Places, &'a mut Found),
        problem: &Problem<'a, L>,
        warmstart: &'a [L],
        work: &'a mut SolverWork<L>,
    ) -> Option<Self> {
        let constraint = problem.constraint;
        let newton = problem.model.options.solver == options::Solver::Newton;
        let apart = constraint.between_trees && constraint.apart().next().is_some();
        let both = if constraint.jacobian.is_empty() { &[] } else { &constraint.contact_rows[..] };
        if !newton || apart || !code.has_rounds() || couplings(both).any(|row| code.couple(row.pair).is_none()) {
            return None;
        }
        if constraint.between_trees {
            work.fields.pull.fill(L::zero());
        }
        Some(Bound {
            code,
            places,
            kinds: &constraint.kinds,
            both,
            found,
            factor: Factor::Tree,
            whole: true,
            fields: fields::table(problem, warmstart, work),
            session: Session::new(scratch),
            parts: [None; solver::ALL.len()],
            lists: [None; contacts::ALL.len()],
            couplings: None,
        })
    }

    /// Runs a part of the solver.
    fn part(&mut self, part: SolverPart, open: u32) -> [u32; 2] {
        let number = solver::number(part);
        let Bound { code, session, fields, parts, factor, .. } = self;
        let code = *code;
        let call = *parts[number].get_or_insert_with(|| {
            let fields = solver::fields(part).0.iter().map(|field| fields[*field as usize].again());
            let fragment = match (part, factor) {
                (SolverPart::Descend { filled: true } | SolverPart::Polish { filled: true }, Factor::Filled(place)) => {
                    code.patterns.get(code, *place, part)
                }
                _ => code.solver(part),
            };
            session.bind(fragment.expect(COMPILED), fields)
        });
        session.run(call, open)
    }

    /// Runs a part of the solver for the contacts that have it.
    fn contacts(&mut self, part: ContactPart, open: u32) {
        let Bound { code, places, kinds, session, fields, lists, whole, .. } = self;
        let (code, places) = (*code, &**places);
        let kinds = kinds.iter().enumerate().filter(|(_, kind)| contacts::applies(part, **kind));
        let kinds = kinds.filter(|(number, _)| !places.all(*number).is_empty());
        let first = *lists[contacts::number(part)].get_or_insert_with(|| {
            let first = session.next();
            for (number, kind) in kinds.clone() {
                let fields = contacts::fields(part, kind.cone).iter().map(|(field, _)| fields[*field as usize].again());
                session.bind_each(code.contact(part, *kind).expect(COMPILED), fields, places.all(number));
            }
            first
        });
        for (call, (number, _)) in kinds.enumerate() {
            let windows = if *whole { places.all(number) } else { places.active(number) };
            session.run_each(first.later(call), open, windows);
        }
    }

    /// Adds the contacts whose sides both move, and that act in a world of `open`, to the Hessian.
    fn couple(&mut self, open: u32) {
        let Bound { code, both, session, fields, couplings: bound, .. } = self;
        let code = *code;
        let first = *bound.get_or_insert_with(|| {
            let first = session.next();
            for row in couplings(both) {
                let (dim, dofs) = (row.dim as usize, code.tables.pairs[row.pair as usize].dofs.len as usize);
                let part = |field: Field, start: u32, len| fields[field as usize].part(start as usize, len);
                let parts = [
                    part(Field::Strengths, 7 * row.strength, 7),
                    part(Field::Jacobian, row.jacobian, dim * dofs),
                    part(Field::Y, row.component, dim),
                    fields[Field::Hessian as usize].again(),
                ];
                let parts = parts.iter().map(FieldSlice::again);
                session.bind(code.couple(row.pair).expect(COMPILED), parts);
            }
            first
        });
        for (call, _) in couplings(both).enumerate().filter(|(_, row)| row.lanes & open != 0) {
            session.run(first.later(call), 0);
        }
    }
}

impl<L: Block> Bound<'_, L> {
    /// Chooses the pattern of the factor for contacts that act in a world of `open`.
    fn choose_factor(&mut self, open: u32) {
        let Bound { code, both, found, parts, factor, .. } = self;
        let tables = &code.tables;
        let act = couplings(both).filter(|row| row.lanes & open != 0);
        let mut joining = act.filter(|row| tables.pairs[row.pair as usize].cross).peekable();
        let mut joined = Joined::default();
        let next = if joining.peek().is_none() {
            Factor::Tree
        } else if joining.all(|row| code.patterns.add(row.pair, &mut joined)) {
            let place = found.find(&code.patterns, tables, &joined);
            let place = place.filter(|place| code.has_pattern(*place));
            place.map_or(Factor::Full, Factor::Filled)
        } else {
            Factor::Full
        };
        if next != *factor {
            for filled in [SolverPart::Descend { filled: true }, SolverPart::Polish { filled: true }] {
                parts[solver::number(filled)] = None;
            }
            *factor = next;
        }
    }
}

/// Those of the contacts whose sides both move.
fn couplings(rows: &[ContactRow]) -> impl Iterator<Item = &ContactRow> {
    rows.iter().filter(|row| row.sides != Sides::One)
}

impl<L: Block> Rounds<L> for Bound<'_, L> {
    fn start(&mut self) {
        self.part(SolverPart::Depart, 0);
        self.contacts(ContactPart::Survey, 0);
        let [warm, _] = self.part(SolverPart::Choose, 0);
        self.contacts(ContactPart::Choose, warm);
    }

    fn direct(&mut self, _: bool, open: L::Mask) {
        let open = L::bits(open);
        self.places.narrow(open);
        // In single precision the factor is used once more, for worlds that no longer iterate: it needs all contacts.
        let factored = if L::Real::EPSILON > 1e-10 { u32::MAX } else { open };
        self.whole = factored != open;
        self.contacts(ContactPart::Stiffen, 0);
        self.whole = false;
        if couplings(self.both).all(|row| row.lanes & factored == 0) {
            self.factor = Factor::Tree;
            self.part(SolverPart::Turn, 0);
        } else {
            self.choose_factor(factored);
            self.part(SolverPart::Curve, 0);
            self.couple(factored);
            self.part(SolverPart::Descend { filled: self.factor.filled() }, 0);
        }
        self.contacts(ContactPart::Approach, 0);
    }

    fn polish(&mut self) {
        self.whole = true;
        self.part(SolverPart::Polish { filled: self.factor.filled() }, 0);
        self.contacts(ContactPart::Approach, 0);
    }

    fn probe(&mut self, first: bool, open: L::Mask) -> Trial<L::Mask> {
        if !first {
            self.contacts(ContactPart::Slope, 0);
        }
        let [open, full] = self.part(SolverPart::Probe { first }, L::bits(open));
        Trial { open: L::mask_of(open), full: L::mask_of(full) }
    }

    fn follow(&mut self, open: L::Mask) -> Arrival<L::Mask> {
        let open = L::bits(open);
        self.contacts(ContactPart::Act, open);
        let [converged, still] = self.part(SolverPart::Gather, open);
        Arrival { converged: L::mask_of(converged), still: L::mask_of(still) }
    }
}
