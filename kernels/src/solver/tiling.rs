//! Which tiles a block's Hessian has, and what is done with them in which order.

use super::tiles::Tile;
use crate::constraint::ContactRow;
use crate::model::{LONGEST, Model, Sides, Span, Tiles};

/// What is done with a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// [`clear`](super::clear)
    Clear,
    /// [`couple_tile`](super::couple_tile)
    Couple,
    /// [`pivot`](super::pivot)
    Pivot,
    /// [`panel`](super::panel)
    Panel,
    /// [`eliminate`](super::eliminate) on the diagonal
    Square,
    /// [`eliminate`](super::eliminate)
    Eliminate,
    /// [`forward`](super::forward)
    Forward,
    /// [`forward_tile`](super::forward_tile)
    ForwardTile,
    /// [`backward_tile`](super::backward_tile)
    BackwardTile,
    /// [`backward`](super::backward)
    Backward,
}

impl Work {
    /// All.
    pub const ALL: [Work; 10] = [
        Work::Clear,
        Work::Couple,
        Work::Pivot,
        Work::Panel,
        Work::Square,
        Work::Eliminate,
        Work::Forward,
        Work::ForwardTile,
        Work::BackwardTile,
        Work::Backward,
    ];

    /// Number of strips that decide the shape of the code; of contacts the tables tell.
    pub fn strips(self) -> usize {
        match self {
            Work::Couple => 0,
            Work::Pivot | Work::Forward | Work::Backward => 1,
            Work::Clear | Work::Panel | Work::Square | Work::ForwardTile | Work::BackwardTile => 2,
            Work::Eliminate => 3,
        }
    }
}

/// Parts of a Newton step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// What contacts add.
    Couple,
    /// The factor.
    Factor,
    /// The solution.
    Solve,
}

/// The same work on tiles of one shape, one after the other.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    /// What is done.
    pub work: Work,
    /// Shape.
    pub shape: u32,
    /// Among the tiles, or among the contacts' patches.
    pub items: Span,
}

/// What is done with the tiles of a block.
#[derive(Clone, Debug, Default)]
pub struct Tiling {
    /// By strip, the strips up to it with which it has tiles, as bits.
    bits: Vec<u64>,
    /// Words of a strip's bits.
    words: usize,
    stretches: Vec<Stretch>,
    /// Where the stretches of a phase end.
    ends: [usize; 3],
    /// Tiles of stretches.
    pub tiles: Vec<Tile>,
    /// Contacts and their patches: number of the shape, place in the list, number of the patch.
    pub patches: Vec<[u32; 3]>,
    /// The contacts that couple: pair, and where each has its numbers; and whether some join trees or branches.
    known: Vec<[u32; 4]>,
    joined: Option<bool>,
    columns: Vec<usize>,
}

impl Tiling {
    /// Forgets what is known.
    pub fn forget(&mut self) {
        self.joined = None;
    }

    /// The stretches of a phase.
    pub fn phase(&self, phase: Phase) -> std::ops::Range<usize> {
        let start = if phase == Phase::Couple { 0 } else { self.ends[phase as usize - 1] };
        start..self.ends[phase as usize]
    }

    /// One of them.
    #[inline(always)]
    pub fn stretch(&self, number: usize) -> Stretch {
        self.stretches[number]
    }

    /// Number of all.
    pub fn count(&self) -> usize {
        self.stretches.len()
    }

    /// Finds what is to be done for the contacts that act in some world of `acting`, unless that is known already. Returns whether they
    /// join branches, and whether anything is new.
    pub fn find<T>(&mut self, model: &Model<T>, rows: &[ContactRow], acting: u32) -> (bool, bool) {
        let couples = |row: &ContactRow| row.sides != Sides::One && row.lanes & acting != 0;
        let coupling = || rows.iter().filter(|row| couples(row));
        let places = || coupling().map(|row| [row.pair, row.strength, row.component, row.jacobian]);
        if let Some(joined) = self.joined
            && places().eq(self.known.iter().copied())
        {
            return (joined, false);
        }
        self.known.clear();
        self.known.extend(places());
        let joined = coupling().any(|row| model.pairs[row.pair as usize].cross);
        self.joined = Some(joined);
        if joined {
            self.list(model, rows, &couples);
        }
        (joined, joined)
    }

    fn list<T>(&mut self, model: &Model<T>, rows: &[ContactRow], couples: &dyn Fn(&ContactRow) -> bool) {
        let tiles = &model.tiles;
        let strips = tiles.strips.len();
        self.words = strips.div_ceil(64);
        self.bits.clear();
        self.bits.resize(strips * self.words, 0);
        self.stretches.clear();
        self.tiles.clear();
        self.patches.clear();
        for (place, row) in (0..).zip(rows).filter(|(_, row)| couples(row)) {
            for number in tiles.patches(row.pair) {
                let patch = tiles.patch(number);
                self.set(patch.strips.map(|strip| strip as usize));
                self.patches.push([patch.shape, place, number as u32]);
            }
        }
        // By shape, in the order of the list: an order that depends on no other contact.
        self.patches.sort_unstable();
        self.close(model);
        for n in 0..self.patches.len() {
            self.push(Work::Couple, self.patches[n][0], n as u32);
        }
        self.ends[0] = self.stretches.len();
        for k in (0..strips).rev() {
            self.factor(tiles, k);
        }
        self.ends[1] = self.stretches.len();
        self.solve(tiles);
        self.ends[2] = self.stretches.len();
    }

    fn set(&mut self, [i, j]: [usize; 2]) {
        self.bits[i * self.words + j / 64] |= 1 << (j % 64);
    }

    fn has(&self, i: usize, j: usize) -> bool {
        self.bits[i * self.words + j / 64] >> (j % 64) & 1 != 0
    }

    /// Adds the tiles of trees and those that elimination fills in; the latter, and those of contacts, are cleared first.
    fn close<T>(&mut self, model: &Model<T>) {
        let tiles = &model.tiles;
        let of_tree = |i: usize, j: usize| {
            let column = tiles.strips[j].start as usize;
            let row = tiles.strips[i].start as usize;
            i == j || model.tree_pattern.row(row).iter().any(|run| run.range().contains(&column))
        };
        let strips = tiles.strips.len();
        for i in 0..strips {
            (0..=i).filter(|j| of_tree(i, *j)).for_each(|j| self.set([i, j]));
        }
        for k in (0..strips).rev() {
            for i in 0..k {
                if !self.has(k, i) {
                    continue;
                }
                for word in 0..=i / 64 {
                    let below = if word == i / 64 { u64::MAX >> (63 - i % 64) } else { u64::MAX };
                    self.bits[i * self.words + word] |= self.bits[k * self.words + word] & below;
                }
            }
        }
        for i in 0..strips {
            for j in 0..i {
                if self.has(i, j) && !of_tree(i, j) {
                    let tile = Tile { target: span(tiles, i, j), ..Tile::default() };
                    self.add(Work::Clear, tiles.shape(&[tiles.strips[i].len, tiles.strips[j].len]), tile);
                }
            }
        }
    }

    /// Elimination of a strip.
    fn factor(&mut self, tiles: &Tiles, k: usize) {
        let strips = &tiles.strips;
        let (own, n) = (span(tiles, k, k), strips[k].len);
        let panel_of = |j: usize| Span { start: LONGEST as u32 * strips[j].start, len: n * strips[j].len };
        let dofs = |j: usize| [strips[k], strips[j]];
        self.add(Work::Pivot, tiles.shape(&[n]), Tile { target: own, dofs: dofs(k), ..Tile::default() });
        let mut columns = std::mem::take(&mut self.columns);
        columns.clear();
        columns.extend((0..k).filter(|j| self.has(k, *j)));
        for j in &columns {
            let tile = Tile { target: span(tiles, k, *j), source: own, panel: panel_of(*j), dofs: dofs(*j) };
            self.add(Work::Panel, tiles.shape(&[n, strips[*j].len]), tile);
        }
        for j in &columns {
            let tile =
                Tile { target: span(tiles, *j, *j), source: span(tiles, k, *j), panel: panel_of(*j), dofs: dofs(*j) };
            self.add(Work::Square, tiles.shape(&[n, strips[*j].len]), tile);
        }
        for (c, j) in columns.iter().enumerate() {
            for i in &columns[c + 1..] {
                let tile = Tile {
                    target: span(tiles, *i, *j),
                    source: span(tiles, k, *j),
                    panel: panel_of(*i),
                    dofs: dofs(*j),
                };
                self.add(Work::Eliminate, tiles.shape(&[n, strips[*j].len, strips[*i].len]), tile);
            }
        }
        self.columns = columns;
    }

    fn solve(&mut self, tiles: &Tiles) {
        let strips = &tiles.strips;
        let own = |k: usize| Tile { source: span(tiles, k, k), dofs: [strips[k]; 2], ..Tile::default() };
        let between = |k: usize, j: usize| Tile { source: span(tiles, k, j), dofs: [strips[k], strips[j]], ..own(k) };
        let shape = |k: usize, j: usize| tiles.shape(&[strips[k].len, strips[j].len]);
        for k in (0..strips.len()).rev() {
            self.add(Work::Forward, tiles.shape(&[strips[k].len]), own(k));
            for j in 0..k {
                if self.has(k, j) {
                    self.add(Work::ForwardTile, shape(k, j), between(k, j));
                }
            }
        }
        for k in 0..strips.len() {
            for j in 0..k {
                if self.has(k, j) {
                    self.add(Work::BackwardTile, shape(k, j), between(k, j));
                }
            }
            self.add(Work::Backward, tiles.shape(&[strips[k].len]), own(k));
        }
    }

    fn add(&mut self, work: Work, shape: u32, tile: Tile) {
        let place = self.tiles.len() as u32;
        self.tiles.push(tile);
        self.push(work, shape, place);
    }

    fn push(&mut self, work: Work, shape: u32, place: u32) {
        match self.stretches.last_mut() {
            Some(last) if last.work == work && last.shape == shape && last.items.start + last.items.len == place => {
                last.items.len += 1;
            }
            _ => self.stretches.push(Stretch { work, shape, items: Span { start: place, len: 1 } }),
        }
    }
}

/// Where a tile is.
fn span(tiles: &Tiles, i: usize, j: usize) -> Span {
    Span { start: tiles.start(i, j), len: tiles.strips[i].len * tiles.strips[j].len }
}

/// A tile of a shape for which code is recorded, beside nothing that it has to do with.
pub fn prototype(tiles: &Tiles, work: Work, shape: u32) -> Tile {
    let lens = tiles.lens_of(shape, work.strips());
    let n = lens[0];
    let b = lens.get(1).copied().unwrap_or(n);
    let at = |start: u32, len: u32| Span { start, len };
    let dofs = [at(0, n), at(n, b)];
    match work {
        Work::Couple => Tile::default(),
        Work::Clear => Tile { target: at(0, n * b), ..Tile::default() },
        Work::Pivot => Tile { target: at(0, n * n), dofs: [dofs[0]; 2], ..Tile::default() },
        Work::Panel => Tile { target: at(0, n * b), source: at(n * b, n * n), panel: at(0, n * b), dofs },
        Work::Square => Tile { target: at(0, b * b), source: at(b * b, n * b), panel: at(0, n * b), dofs },
        Work::Eliminate => {
            let rows = lens[2];
            Tile { target: at(0, rows * b), source: at(rows * b, n * b), panel: at(0, n * rows), dofs }
        }
        Work::Forward | Work::Backward => Tile { source: at(0, n * n), dofs: [dofs[0]; 2], ..Tile::default() },
        Work::ForwardTile | Work::BackwardTile => Tile { source: at(0, n * b), dofs, ..Tile::default() },
    }
}
