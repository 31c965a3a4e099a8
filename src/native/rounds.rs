//! Newton's iteration with all its parts in code, each bound when it is first needed and kept from solve to solve.

use lanesim_codegen::{Block, Scratch, Session};
use lanesim_kernels::code::{ContactPart, SolverPart};
use lanesim_kernels::constraint::Kind;
use lanesim_kernels::lane::Real;
use lanesim_kernels::options;
use lanesim_kernels::solver::{Arrival, Problem, Rounds, SolverWork, Trial};

use super::contacts::{self, Places};
use super::fields;
use super::patterns::{self, Found, Joined};
use super::{ModelCode, solver};

/// What the type says that holds them: parts for which there is no code are not bound.
const COMPILED: &str = "all parts have code";
const BOUND: &str = "a call that was just bound";
/// All worlds of a block.
const ALL: u32 = u32::MAX;

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

/// Numbers of calls: parts by their place in [`solver::ALL`], then the two that factors on filled patterns have, by the
/// patterns' places, then parts of contacts by kind, then pairs.
const FILLED: usize = solver::ALL.len();
const LISTS: usize = FILLED + 2 * patterns::MOST;

/// The parts of an iteration.
pub struct Bound<'a, L: Block> {
    code: &'a ModelCode<L::Float>,
    places: &'a mut Places,
    kinds: &'a [Kind],
    found: &'a mut Found,
    factor: Factor,
    /// The worlds for whose contacts it was chosen; `None`: it was not yet.
    chosen: Option<u32>,
    /// Whether contacts are worked through that act only in worlds that no longer iterate.
    whole: bool,
    session: Session<'a, L::Float>,
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
        let apart = constraint.by_jacobian && (constraint.apart().next().is_some() || !constraint.equality.is_empty());
        let coupled = || places.couplings().iter().all(|coupling| code.couple(coupling.pair).is_some());
        if !newton || apart || !code.has_rounds() || !coupled() {
            return None;
        }
        if constraint.by_jacobian {
            work.fields.pull.fill(L::zero());
        }
        let session = Session::new(scratch, &fields::table(problem, warmstart, work));
        let (factor, chosen, whole) = (Factor::Tree, None, true);
        Some(Bound { code, places, kinds: &constraint.kinds, found, factor, chosen, whole, session })
    }

    /// Runs a part of the solver for the worlds of `open`, or for more.
    #[inline]
    fn part(&mut self, part: SolverPart, open: u32) -> [u32; 2] {
        let call = match (part, self.factor) {
            (SolverPart::Descend { filled: true }, Factor::Filled(place)) => FILLED + 2 * place,
            (SolverPart::Polish { filled: true }, Factor::Filled(place)) => FILLED + 2 * place + 1,
            _ => solver::number(part),
        };
        match self.session.run(call, open, open) {
            Some(masks) => masks,
            None => self.bind(part, call, open),
        }
    }

    /// Makes a part ready, and runs it.
    #[cold]
    fn bind(&mut self, part: SolverPart, call: usize, open: u32) -> [u32; 2] {
        let fragment = if call < FILLED {
            self.code.solver(part)
        } else {
            self.code.patterns.get(self.code, (call - FILLED) / 2, part)
        };
        let fields = solver::fields(part).0.iter().map(|field| *field as usize);
        self.session.bind(call, fragment.expect(COMPILED), fields);
        self.session.run(call, open, open).expect(BOUND)
    }

    /// Runs a part of the solver for the contacts that have it, with a mask, for the worlds of `lanes`, or for more.
    #[inline]
    fn contacts(&mut self, part: ContactPart, masks: [u32; 2]) {
        for place in 0..self.places.present().len() {
            let number = self.places.present()[place];
            let windows = if self.whole { self.places.all(number) } else { self.places.active(number) };
            if windows.is_empty() || !contacts::applies(part, self.kinds[number]) {
                continue;
            }
            let call = LISTS + contacts::ALL.len() * number + contacts::number(part);
            if self.session.run_each(call, masks, windows).is_none() {
                bind_contacts::<L>(&mut self.session, self.code, (part, self.kinds[number]), call);
                self.session.run_each(call, masks, windows).expect(BOUND);
            }
        }
    }

    /// Adds the contacts whose sides both move, and that act in a world of `factored`, to the Hessian of the worlds of `open`.
    fn couple(&mut self, factored: u32, open: u32) {
        let pairs = LISTS + contacts::ALL.len() * self.kinds.len();
        for (number, coupling) in self.places.couplings().iter().enumerate() {
            if coupling.lanes & factored == 0 {
                continue;
            }
            let call = pairs + self.code.first_pair[coupling.pair as usize] as usize;
            let windows = self.places.coupling(number);
            if self.session.run_each(call, [0, open], windows).is_none() {
                let fields = contacts::COUPLE.into_iter().map(|(field, _)| field as usize);
                self.session.bind_each(call, self.code.couple(coupling.pair).expect(COMPILED), fields);
                self.session.run_each(call, [0, open], windows).expect(BOUND);
            }
        }
    }
}

#[cold]
fn bind_contacts<L: Block>(
    session: &mut Session<'_, L::Float>,
    code: &ModelCode<L::Float>,
    (part, kind): (ContactPart, Kind),
    call: usize,
) {
    let fields = contacts::fields(part).iter().map(|(field, _)| *field as usize);
    session.bind_each(call, code.contact(part, kind).expect(COMPILED), fields);
}

impl<L: Block> Bound<'_, L> {
    /// Chooses the pattern of the factor for contacts that act in a world of `open`.
    fn choose_factor(&mut self, open: u32) {
        if self.chosen.replace(open) == Some(open) {
            return;
        }
        let Bound { code, places, found, factor, .. } = self;
        let tables = &code.tables;
        let act = places.couplings().iter().filter(|coupling| coupling.lanes & open != 0);
        let mut joining = act.filter(|coupling| tables.pairs[coupling.pair as usize].cross).peekable();
        let mut joined = Joined::default();
        let next = if joining.peek().is_none() {
            Factor::Tree
        } else if joining.all(|coupling| code.patterns.add(coupling.pair, &mut joined)) {
            let place = found.find(&code.patterns, tables, &joined);
            let place = place.filter(|place| code.has_pattern(*place));
            place.map_or(Factor::Full, Factor::Filled)
        } else {
            Factor::Full
        };
        *factor = next;
    }
}

impl<L: Block> Rounds for Bound<'_, L> {
    fn start(&mut self) {
        self.part(SolverPart::Depart, ALL);
        self.contacts(ContactPart::Survey, [0, ALL]);
        let [warm, _] = self.part(SolverPart::Choose, ALL);
        self.contacts(ContactPart::Choose, [warm, ALL]);
    }

    fn direct(&mut self, _: bool, open: u32) {
        self.places.narrow(open);
        // In single precision the factor is used once more, for worlds that no longer iterate: it needs all contacts.
        let factored = if L::Real::EPSILON > 1e-10 { u32::MAX } else { open };
        self.whole = factored != open;
        self.contacts(ContactPart::Stiffen, [0, open]);
        self.whole = false;
        if self.places.couplings().iter().all(|coupling| coupling.lanes & factored == 0) {
            (self.factor, self.chosen) = (Factor::Tree, None);
            self.part(SolverPart::Turn, open);
        } else {
            self.choose_factor(factored);
            self.part(SolverPart::Curve, open);
            self.couple(factored, open);
            self.part(SolverPart::Descend { filled: self.factor.filled() }, open);
        }
        self.contacts(ContactPart::Approach, [0, open]);
    }

    fn polish(&mut self, open: u32) {
        self.part(SolverPart::Polish { filled: self.factor.filled() }, open);
    }

    fn probe(&mut self, first: bool, open: u32) -> Trial<u32> {
        if !first {
            self.contacts(ContactPart::Slope, [0, open]);
        }
        let [open, full] = self.part(SolverPart::Probe { first }, open);
        Trial { open, full }
    }

    fn follow(&mut self, open: u32) -> Arrival<u32> {
        self.contacts(ContactPart::Act, [open; 2]);
        let [converged, still] = self.part(SolverPart::Gather, open);
        Arrival { converged, still }
    }
}
