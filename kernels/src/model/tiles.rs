//! Storage of the Hessian of models whose trees touch: tiles, which are dense, of strips of dofs along a chain. A block has few
//! of all tiles that could be, and code for a tile serves all tiles of its shape.

use std::collections::HashMap;

use super::{Crossing, LONGEST, Model, Pair, PairDof, Sides, Span, Strips};
use crate::options::Solver;

/// Fewest dofs of a model for which tiles pay.
const FEWEST_DOFS: usize = 24;

/// The tiles of a model; empty if its Hessian is stored by the skyline alone.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tiles {
    /// Dofs of every strip.
    pub strips: Vec<Span>,
    /// Lengths that strips have, ascending.
    pub lens: Vec<u32>,
    /// Entries of all tiles.
    pub entries: usize,
    /// By strip, the first strip that it can ever be coupled with.
    firsts: Vec<u32>,
    /// By strip, where the tile with the first of these starts; those up to the strip itself follow.
    starts: Vec<u32>,
    /// By pair, what its contacts add to.
    of_pairs: Vec<Span>,
    patches: Vec<Patch>,
    /// Of every shape of those, a pair and one of its patches.
    pub shapes: Vec<(u32, Patch)>,
}

/// A tile to which a contact adds, on those of its dofs that the contact's sides are moved by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patch {
    /// Number of its shape.
    pub shape: u32,
    /// Strips of the rows and of the columns.
    pub strips: [u32; 2],
    /// Rows: from which on, and how many, of the dofs of the pair.
    pub rows: Span,
    /// Columns, likewise.
    pub columns: Span,
    /// First entry.
    pub target: u32,
    /// Entries from row to row.
    pub stride: u32,
}

impl Patch {
    /// Whether it is on the diagonal, of which the lower half matters.
    #[inline(always)]
    pub fn diagonal(&self) -> bool {
        self.strips[0] == self.strips[1]
    }

    /// Entries from the first to the last.
    pub fn extent(&self) -> usize {
        ((self.rows.len - 1) * self.stride + self.columns.len) as usize
    }
}

impl Tiles {
    /// The tiles of a model whose trees touch, if it is large enough.
    pub fn new(model: &Model<f64>) -> Tiles {
        let apart = |pair: &Pair<f64>| pair.sides == Sides::Apart && pair.cross;
        // Rows along tendons add to the skyline.
        let joined = model.equalities.iter().any(|equality| equality.cross) || !model.tendons.is_empty();
        let newton = model.options.solver == Solver::Newton;
        let small = model.sizes.nv < FEWEST_DOFS;
        if small || joined || !newton || !model.own.is_empty() || !model.pairs.iter().any(apart) {
            return Tiles::default();
        }
        let strips = Strips::new(&model.dofs);
        let lens = strips.spans.iter().map(|strip| strip.len).collect();
        let mut tiles = Tiles { lens, strips: strips.spans.clone(), ..Tiles::default() };
        tiles.lens.sort_unstable();
        tiles.lens.dedup();
        let mut entries = 0;
        for (i, strip) in tiles.strips.iter().enumerate() {
            let lowest = strip.range().map(|dof| model.rows.first[dof]).min().unwrap_or(strip.start);
            let first = strips.of(lowest);
            tiles.firsts.push(first);
            tiles.starts.push(entries);
            entries += tiles.strips[first as usize..=i].iter().map(|column| strip.len * column.len).sum::<u32>();
        }
        tiles.entries = entries as usize;
        let mut shapes = HashMap::new();
        for (number, pair) in (0..).zip(&model.pairs) {
            let start = tiles.patches.len() as u32;
            if pair.sides != Sides::One && !pair.rigid() {
                tiles.join((number, pair.condim), &model.pair_dofs[pair.dofs.range()], &strips, &mut shapes);
            }
            tiles.of_pairs.push(Span { start, len: tiles.patches.len() as u32 - start });
        }
        tiles
    }

    /// Lists the tiles to which contacts of a pair add.
    fn join(
        &mut self,
        (pair, dim): (u32, u32),
        dofs: &[PairDof],
        strips: &Strips,
        shapes: &mut HashMap<(u32, u32, u32, u32, bool), u32>,
    ) {
        for Crossing { strips: [i, j], rows, columns, place: [row, column] } in strips.crossings(dofs) {
            let stride = self.strips[j as usize].len;
            let target = self.start(i as usize, j as usize) + row * stride + column;
            let next = self.shapes.len() as u32;
            let shape = *shapes.entry((dim, rows.len, columns.len, stride, i == j)).or_insert(next);
            let patch = Patch { shape, strips: [i, j], rows, columns, target, stride };
            if shape == next {
                self.shapes.push((pair, patch));
            }
            self.patches.push(patch);
        }
    }

    /// Entries for tiles, and for multipliers of a strip.
    pub fn room(&self) -> (usize, usize) {
        let dofs = self.strips.last().map_or(0, |strip| strip.range().end);
        (self.entries.max(3 * LONGEST * LONGEST), LONGEST * dofs)
    }

    /// Whether there are none.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.strips.is_empty()
    }

    /// Where a tile starts.
    #[inline(always)]
    pub fn start(&self, i: usize, j: usize) -> u32 {
        let first = self.strips[self.firsts[i] as usize].start;
        self.starts[i] + self.strips[i].len * (self.strips[j].start - first)
    }

    /// The tiles to which contacts of a pair add.
    pub fn patches(&self, pair: u32) -> std::ops::Range<usize> {
        self.of_pairs[pair as usize].range()
    }

    /// One of these.
    #[inline(always)]
    pub fn patch(&self, number: usize) -> &Patch {
        &self.patches[number]
    }

    /// Number of the shape of tiles of strips of these lengths.
    #[inline(always)]
    pub fn shape(&self, lens: &[u32]) -> u32 {
        let place = |len: &u32| self.lens.iter().position(|known| known == len).unwrap_or(0) as u32;
        lens.iter().fold(0, |shape, len| shape * self.lens.len() as u32 + place(len))
    }

    /// Lengths of the strips of so many of a shape.
    pub fn lens_of(&self, mut shape: u32, count: usize) -> Vec<u32> {
        let mut lens = vec![0; count];
        for len in lens.iter_mut().rev() {
            *len = self.lens[shape as usize % self.lens.len()];
            shape /= self.lens.len() as u32;
        }
        lens
    }

    /// Whether there are different strips of these lengths.
    pub fn has(&self, lens: &[u32]) -> bool {
        let count = |len: u32, of: &mut dyn Iterator<Item = u32>| of.filter(|other| *other == len).count();
        lens.iter().all(|len| {
            count(*len, &mut lens.iter().copied()) <= count(*len, &mut self.strips.iter().map(|strip| strip.len))
        })
    }
}
