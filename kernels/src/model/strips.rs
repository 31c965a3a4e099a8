//! Runs of dofs along a chain, by which the Hessian of models whose trees touch is taken apart.

use super::{Dof, NONE, Pair, PairDof, Sides, Span};
use crate::options::{Options, Solver};

/// Most dofs of a strip: tiles of so many rows and columns nearly fit into the registers of a core.
pub const LONGEST: usize = 6;
/// Fewest strips of a model of which every world has a pattern of its own; of fewer, what a block's worlds have together is
/// eliminated in all at once. A guess between 27 capsules, which tiles suit, and a heap of 216 spheres, which they do not.
const FEWEST_OWN: usize = 40;

/// Strips of dofs, and where each dof is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Strips {
    /// Dofs of every strip.
    pub spans: Vec<Span>,
    /// By dof, its strip.
    of: Vec<u32>,
}

/// Part of the block of two strips: that of those of their dofs that the sides of a contact are moved by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crossing {
    /// Strips of the rows and of the columns.
    pub strips: [u32; 2],
    /// Rows: from which on, and how many, of the dofs of the pair.
    pub rows: Span,
    /// Columns, likewise.
    pub columns: Span,
    /// First row and column within the block.
    pub place: [u32; 2],
}

impl Strips {
    /// Runs along a chain without a branch.
    pub fn new(dofs: &[Dof<f64>]) -> Strips {
        let mut children = vec![0_u32; dofs.len()];
        dofs.iter().filter(|dof| dof.parent != NONE).for_each(|dof| children[dof.parent as usize] += 1);
        let mut strips = Strips::default();
        for (i, dof) in (0..).zip(dofs) {
            match strips.spans.last_mut() {
                Some(strip)
                    if i > 0
                        && dof.parent == i - 1
                        && children[dof.parent as usize] == 1
                        && (strip.len as usize) < LONGEST =>
                {
                    strip.len += 1;
                }
                _ => strips.spans.push(Span { start: i, len: 1 }),
            }
            strips.of.push(strips.spans.len() as u32 - 1);
        }
        strips
    }

    /// The strips of a model of which every world has a Hessian with a pattern of its own (see [`sparse`](crate::solver::sparse));
    /// empty if it has not. `joined`: whether anything but contacts joins branches.
    pub fn own(dofs: &[Dof<f64>], pairs: &[Pair<f64>], joined: bool, options: &Options) -> Strips {
        let strips = Strips::new(dofs);
        let touch = pairs.iter().any(|pair| pair.sides == Sides::Apart && pair.cross);
        let own = touch && !joined && options.solver == Solver::Newton && strips.spans.len() >= FEWEST_OWN;
        if own { strips } else { Strips::default() }
    }

    /// Whether there are none.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.spans.is_empty()
    }

    /// The strip of a dof.
    #[inline(always)]
    pub fn of(&self, dof: u32) -> u32 {
        self.of[dof as usize]
    }

    /// The strips that dofs, which ascend, are on: strip, and which of the dofs.
    pub fn runs<'a>(&'a self, dofs: &'a [PairDof]) -> impl Iterator<Item = (u32, Span)> + Clone + 'a {
        let mut start = 0;
        std::iter::from_fn(move || {
            let strip = self.of(dofs.get(start)?.dof);
            let len = dofs[start..].iter().take_while(|entry| self.of(entry.dof) == strip).count();
            let run = Span { start: start as u32, len: len as u32 };
            start += len;
            Some((strip, run))
        })
    }

    /// The parts of blocks to which contacts of a pair with these dofs add, in the lower triangle.
    pub fn crossings<'a>(&'a self, dofs: &'a [PairDof]) -> impl Iterator<Item = Crossing> + 'a {
        let place = |strip: u32, run: &Span| dofs[run.start as usize].dof - self.spans[strip as usize].start;
        self.runs(dofs).enumerate().flat_map(move |(r, (i, rows))| {
            self.runs(dofs).take(r + 1).map(move |(j, columns)| Crossing {
                strips: [i, j],
                rows,
                columns,
                place: [place(i, &rows), place(j, &columns)],
            })
        })
    }
}
