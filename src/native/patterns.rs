//! Code for the factor of the Hessian where contacts join branches, for the patterns that they fill in.
//!
//! All contacts that a model can have fill in far more than those that a block has at once. Patterns are compiled when they are
//! first met, up to a number; then, and for models with very many pairs of links, the smallest that has all entries does.

use std::collections::HashMap;
use std::sync::{Mutex, OnceLock, PoisonError};

use lanesim_codegen::Float;
use lanesim_kernels::model::{Model, Pattern};
use lanesim_kernels::part::{Op, Part};
use lanesim_kernels::solver::Fill;

use super::library::{Coded, ModelCode};

/// Most patterns with code, but for the fullest.
pub const MOST: usize = 12;
/// A wider pattern with code is used if it takes at most this many times the operations.
const GOOD_ENOUGH: f64 = 1.25;
/// Pairs of links that can join branches and be told apart.
const PAIRS: usize = 256;

/// Pairs of links with contacts that join branches, as bits.
pub type Joined = [u64; PAIRS / 64];

/// The code of a model's patterns.
pub struct Patterns<T> {
    /// Number of the pair of links of each pair; `None`: it joins no branches.
    numbers: Vec<Option<usize>>,
    /// A pair of each.
    pairs: Vec<u32>,
    slots: [OnceLock<Filled<T>>; MOST],
    /// Held while a slot is filled.
    filling: Mutex<()>,
}

/// A pattern and its code.
struct Filled<T> {
    pattern: Pattern,
    /// The pairs of links that it has room for. It has room for any of them together, since nothing more can fill in.
    room: Joined,
    operations: usize,
    /// The factor, and its last use.
    code: [OnceLock<Option<Coded<T>>>; 2],
}

impl<T: Float> Patterns<T> {
    /// Nothing compiled yet.
    pub fn new(model: &Model<T>) -> Self {
        let mut known = HashMap::new();
        let mut pairs = vec![];
        let number = |(p, pair): (u32, &lanesim_kernels::model::Pair<T>)| {
            pair.cross.then(|| {
                *known.entry((pair.link1, pair.link2)).or_insert_with(|| {
                    pairs.push(p);
                    pairs.len() - 1
                })
            })
        };
        let numbers = (0..).zip(&model.pairs).map(number).collect();
        Patterns { numbers, pairs, slots: [const { OnceLock::new() }; MOST], filling: Mutex::new(()) }
    }

    /// Adds a pair to those with contacts. Whether it can be told from others.
    pub fn add(&self, pair: u32, joined: &mut Joined) -> bool {
        let Some(number) = self.numbers[pair as usize] else { return true };
        if let Some(word) = joined.get_mut(number / 64) {
            *word |= 1 << (number % 64);
        }
        number < PAIRS
    }

    /// The place of a pattern that has room for the joined pairs; `None`: the fullest.
    fn find(&self, model: &Model<T>, joined: &Joined, fill: &mut Fill) -> Option<usize> {
        let made = || self.slots.iter().map_while(OnceLock::get).enumerate();
        let best = || {
            let fits = made().filter(|(_, filled)| joined.iter().zip(filled.room).all(|(mine, its)| mine & !its == 0));
            fits.min_by_key(|(_, filled)| filled.operations)
        };
        if made().count() == MOST {
            return best().map(|(place, _)| place);
        }
        let present = |number: &usize| joined[number / 64] >> (number % 64) & 1 != 0;
        let pairs = (0..self.pairs.len().min(PAIRS)).filter(present).map(|number| self.pairs[number]);
        fill.find(model, pairs);
        let operations = operations_of(&fill.pattern);
        let enough = (operations as f64 * GOOD_ENOUGH) as usize;
        let _filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        let free = made().count();
        match best() {
            Some((place, filled)) if filled.operations <= enough || free == MOST => Some(place),
            _ if free == MOST => None,
            _ => {
                let (pattern, room) = (fill.pattern.clone(), self.room(model, &fill.pattern));
                let filled = Filled { pattern, room, operations, code: Default::default() };
                self.slots[free].set(filled).ok().map(|()| free)
            }
        }
    }

    /// The pairs of links that a pattern has room for.
    fn room(&self, model: &Model<T>, pattern: &Pattern) -> Joined {
        let mut room = Joined::default();
        let has = |i: u32, j: u32| pattern.row(i as usize).iter().any(|run| run.range().contains(&(j as usize)));
        for (number, pair) in self.pairs.iter().enumerate().take(PAIRS) {
            let dofs = &model.pair_dofs[model.pairs[*pair as usize].dofs.range()];
            let coupled = |n: usize| dofs[..n].iter().all(|before| has(dofs[n].dof, before.dof));
            room[number / 64] |= u64::from((0..dofs.len()).all(coupled)) << (number % 64);
        }
        room
    }

    /// The code of a part on the pattern of a place.
    pub fn get<'a>(&'a self, code: &ModelCode<T>, place: usize, part: Part) -> Option<&'a Coded<T>> {
        let filled = self.slots.get(place)?.get()?;
        let coded = &filled.code[usize::from(part.op == Op::Polish)];
        coded.get_or_init(|| code.on_pattern(part, &filled.pattern)).as_ref()
    }

    /// Whether the factor on the pattern of a place has code.
    pub fn is_coded(&self, code: &ModelCode<T>, place: usize) -> bool {
        [Op::Descend, Op::Polish].into_iter().all(|op| self.get(code, place, Part::of(op, 1)).is_some())
    }
}

/// Multiplications in a factorisation on a pattern.
fn operations_of(pattern: &Pattern) -> usize {
    let entries = |i: usize| pattern.row(i).iter().map(|run| run.len as usize).sum::<usize>();
    (0..pattern.rows.len()).map(entries).map(|n| n * (n + 3) / 2).sum()
}

/// A worker's memory of where patterns are.
pub struct Found {
    /// Asked and answered, at a place that follows from what was asked.
    known: Vec<Option<(Joined, Option<usize>)>>,
    fill: Fill,
}

impl Found {
    /// Nothing yet.
    pub fn new<T: Float>(model: &Model<T>) -> Self {
        Found { known: vec![None; 512], fill: Fill::new(model) }
    }

    /// The place of a pattern that has room for the joined pairs; `None`: the fullest.
    pub fn find<T: Float>(&mut self, patterns: &Patterns<T>, model: &Model<T>, joined: &Joined) -> Option<usize> {
        let mix = |hash: u64, word: &u64| (hash ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
        let place = joined.iter().fold(0, mix) as usize % self.known.len();
        match &self.known[place] {
            Some((known, found)) if known == joined => *found,
            _ => {
                let found = patterns.find(model, joined, &mut self.fill);
                self.known[place] = Some((*joined, found));
                found
            }
        }
    }
}
