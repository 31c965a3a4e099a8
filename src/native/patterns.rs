//! Code for the factor of the Hessian where contacts join branches, for the patterns that they fill in.
//!
//! All contacts that a model can have fill in far more than those that a block has at once. Patterns are compiled when they are
//! first met, up to a number; then, and for models with very many pairs of links, the smallest that has all entries does.

use std::collections::HashMap;
use std::sync::{Mutex, OnceLock, PoisonError};

use lanesim_codegen::{Float, Fragment};
use lanesim_kernels::code::SolverPart;
use lanesim_kernels::model::{Model, Pattern};
use lanesim_kernels::solver::Fill;

use super::solver::{operations_of, record_on};
use super::{ModelCode, Part};

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
    /// Columns of each row.
    bits: Vec<u64>,
    operations: usize,
    descend: Part<T>,
    polish: Part<T>,
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
    fn find(&self, model: &Model<T>, joined: &Joined, fill: &mut Fill, bits: &mut Vec<u64>) -> Option<usize> {
        let present = |number: &usize| joined[number / 64] >> (number % 64) & 1 != 0;
        let pairs = (0..self.pairs.len().min(PAIRS)).filter(present).map(|number| self.pairs[number]);
        fill.find(model, pairs);
        columns(&fill.pattern, bits);
        let operations = operations_of(&fill.pattern);
        let enough = (operations as f64 * GOOD_ENOUGH) as usize;
        let _filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        let made = || self.slots.iter().map_while(OnceLock::get).enumerate();
        let fits = |filled: &Filled<T>| bits.iter().zip(&filled.bits).all(|(mine, its)| mine & !its == 0);
        let best = made().filter(|(_, filled)| fits(filled)).min_by_key(|(_, filled)| filled.operations);
        let free = made().count();
        match best {
            Some((place, filled)) if filled.operations <= enough || free == MOST => Some(place),
            _ if free == MOST => None,
            _ => {
                let (pattern, bits) = (fill.pattern.clone(), bits.clone());
                let filled = Filled { pattern, bits, operations, descend: Part::new(), polish: Part::new() };
                self.slots[free].set(filled).ok().map(|()| free)
            }
        }
    }

    /// The code of a part on the pattern of a place.
    pub fn get<'a>(&'a self, code: &ModelCode<T>, place: usize, part: SolverPart) -> Option<&'a Fragment<T>> {
        let filled = self.slots.get(place)?.get()?;
        let (name, place) = match part {
            SolverPart::Polish { .. } => ("polish filled", &filled.polish),
            _ => ("descend filled", &filled.descend),
        };
        let record = |tables: &Model<T>| record_on(tables, code.structure(), part, &filled.pattern);
        code.get(name, place, |_| filled.operations, record)
    }
}

/// The pattern's columns as bits, row by row.
fn columns(pattern: &Pattern, bits: &mut Vec<u64>) {
    let words = pattern.rows.len().div_ceil(64);
    bits.clear();
    bits.resize(words * pattern.rows.len(), 0);
    for i in 0..pattern.rows.len() {
        for j in pattern.row(i).iter().flat_map(|run| run.range()) {
            bits[i * words + j / 64] |= 1 << (j % 64);
        }
    }
}

/// A worker's memory of where patterns are.
pub struct Found {
    /// Asked and answered, at a place that follows from what was asked.
    known: Vec<Option<(Joined, Option<usize>)>>,
    fill: Fill,
    bits: Vec<u64>,
}

impl Found {
    /// Nothing yet.
    pub fn new<T: Float>(model: &Model<T>) -> Self {
        let nv = model.sizes.nv;
        let bits = Vec::with_capacity(nv.div_ceil(64) * nv);
        Found { known: vec![None; 512], fill: Fill::new(&model.sizes), bits }
    }

    /// The place of a pattern that has room for the joined pairs; `None`: the fullest.
    pub fn find<T: Float>(&mut self, patterns: &Patterns<T>, model: &Model<T>, joined: &Joined) -> Option<usize> {
        let mix = |hash: u64, word: &u64| (hash ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
        let place = joined.iter().fold(0, mix) as usize % self.known.len();
        match &self.known[place] {
            Some((known, found)) if known == joined => *found,
            _ => {
                let found = patterns.find(model, joined, &mut self.fill, &mut self.bits);
                self.known[place] = Some((*joined, found));
                found
            }
        }
    }
}
