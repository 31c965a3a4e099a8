//! Which dofs a whitened row has to do with, and where its numbers are. Whitening takes a row's Jacobian along the rows of M's factor,
//! so a row reaches all that its dofs are coupled to towards the root, and nothing else.

use crate::constraint::{ContactRow, DofRowKind, all_dof_rows};
use crate::lane::Real;
use crate::model::{Model, NONE, Sides, Span};

/// The dofs of rows.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// Of every row of equality constraints, then of every dof row, its stretch of `dofs`.
    rows: Vec<Span>,
    /// Dofs, ascending.
    dofs: Vec<u32>,
    /// Dofs of every tree.
    trees: Vec<Span>,
    /// Number of dofs over which a contact in one tree has its numbers: those of the largest tree, so that one piece of code does for
    /// all; of all dofs, if something couples trees.
    width: u32,
    /// Whether something couples trees.
    coupled: bool,
}

impl Layout {
    /// That of a model.
    pub fn new<T: Real>(model: &Model<T>) -> Self {
        let mut out = Layout { trees: trees(model), ..Layout::default() };
        let reaches = |dof: usize| {
            let tree = out.trees[model.links[model.dofs[dof].link as usize].tree as usize];
            model.tree_pattern.row(dof).iter().any(|run| run.start < tree.start)
        };
        out.coupled = (0..model.sizes.nv).any(reaches);
        let largest = out.trees.iter().map(|tree| tree.len).max().unwrap_or(0);
        out.width = if out.coupled { model.sizes.nv as u32 } else { largest };
        let mut marks = vec![false; model.sizes.nv];
        for equality in &model.equalities {
            for _ in equality.rows() {
                let dofs = model.equality_dofs[equality.dofs.range()].iter().map(|entry| entry.dof);
                out.add(model, dofs, &mut marks);
            }
        }
        for row in all_dof_rows(model) {
            if row.tendon == NONE {
                let count = if row.kind == DofRowKind::Ball { 3 } else { 1 };
                out.add(model, row.dof..row.dof + count, &mut marks);
            } else {
                let dofs = model.tendons[row.tendon as usize].dofs.range();
                out.add(model, model.tendon_dofs[dofs].iter().map(|entry| entry.dof), &mut marks);
            }
        }
        out
    }

    /// Adds a row with these dofs and all that they are coupled to towards the root.
    fn add<T>(&mut self, model: &Model<T>, dofs: impl Iterator<Item = u32>, marks: &mut [bool]) {
        dofs.for_each(|dof| marks[dof as usize] = true);
        let start = self.dofs.len();
        for dof in (0..marks.len()).rev() {
            if std::mem::take(&mut marks[dof]) {
                model.tree_pattern.row(dof).iter().for_each(|run| marks[run.range()].fill(true));
                self.dofs.push(dof as u32);
            }
        }
        self.dofs[start..].reverse();
        self.rows.push(Span { start: start as u32, len: (self.dofs.len() - start) as u32 });
    }

    /// Where a row on joints or of an equality constraint has its numbers, and of which dofs.
    pub fn row(&self, row: usize) -> (std::ops::Range<usize>, &[u32]) {
        let range = self.rows[row].range();
        (range.clone(), &self.dofs[range])
    }

    /// Numbers of these rows.
    pub fn numbers(&self) -> usize {
        self.dofs.len()
    }

    /// Number of these rows.
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Number of dofs over which a contact in one tree has its numbers.
    pub fn width(&self) -> usize {
        self.width as usize
    }

    /// Bytes of the tables.
    pub fn bytes(&self) -> usize {
        (self.rows.len() + self.trees.len()) * size_of::<Span>() + self.dofs.len() * size_of::<u32>()
    }

    /// Where a contact has its numbers, if they begin at the first of `next`, and its edges at the second.
    pub fn place<T>(&self, model: &Model<T>, row: &ContactRow, [start, edge]: [u32; 2]) -> Whitened {
        let all = model.sizes.nv as u32;
        let windows = if self.coupled {
            [Span { start: 0, len: all }, Span::default()]
        } else if row.sides == Sides::Apart {
            let dofs = &model.pair_dofs[model.pairs[row.pair as usize].dofs.range()];
            let first = dofs.first().is_some_and(|entry| entry.second);
            [first, !first].map(|side| {
                let mut of_side = dofs.iter().filter(|entry| entry.second == side).map(|entry| entry.dof);
                let start = of_side.next().unwrap_or(0);
                Span { start, len: of_side.next_back().unwrap_or(start) + 1 - start }
            })
        } else {
            let tree = self.trees[model.links[row.link as usize].tree as usize];
            [Span { start: tree.start.min(all - self.width), len: self.width }, Span::default()]
        };
        Whitened { start, edge, windows }
    }
}

/// The dofs of every tree.
fn trees<T>(model: &Model<T>) -> Vec<Span> {
    let mut trees: Vec<Span> = vec![];
    for link in &model.links {
        let tree = link.tree as usize;
        if trees.len() <= tree {
            trees.resize(tree + 1, Span::default());
        }
        let of_tree = &mut trees[tree];
        if of_tree.len == 0 {
            of_tree.start = link.dofs.start;
        }
        of_tree.len = link.dofs.start + link.dofs.len - of_tree.start;
    }
    trees
}

/// Where a contact has its numbers among those of all.
#[derive(Clone, Copy, Debug, Default)]
pub struct Whitened {
    /// The first.
    pub start: u32,
    /// The first of its edges' forces.
    pub edge: u32,
    /// The dofs of a row; the second stretch is that of the other tree.
    pub windows: [Span; 2],
}

impl Whitened {
    /// Numbers of a row.
    pub fn width(&self) -> usize {
        (self.windows[0].len + self.windows[1].len) as usize
    }

    /// The dofs of a row.
    #[inline(always)]
    pub fn dofs(&self) -> impl Iterator<Item = usize> {
        self.windows[0].range().chain(self.windows[1].range())
    }

    /// Stretches of dofs, each with the place of its first in a row.
    pub fn spans(&self) -> [(Span, usize); 2] {
        [(self.windows[0], 0), (self.windows[1], self.windows[0].len as usize)]
    }

    /// The place of a dof in a row.
    pub fn at(&self, dof: usize) -> usize {
        let [first, second] = self.windows.map(Span::range);
        if first.contains(&dof) { dof - first.start } else { dof - second.start + first.len() }
    }

    /// The row of a component.
    #[inline(always)]
    pub fn component(&self, component: usize) -> std::ops::Range<usize> {
        let start = self.start as usize + component * self.width();
        start..start + self.width()
    }

    /// The rows of all components.
    pub fn rows(&self, row: &ContactRow) -> std::ops::Range<usize> {
        self.start as usize..self.start as usize + row.dim as usize * self.width()
    }

    /// The lower triangle of A's block.
    #[inline(always)]
    pub fn block(&self, row: &ContactRow) -> std::ops::Range<usize> {
        self.rows(row).end..self.end(row) as usize
    }

    /// Where the next contact's begin.
    pub fn end(&self, row: &ContactRow) -> u32 {
        self.start + row.dim * self.width() as u32 + row.dim * (row.dim + 1) / 2
    }

    /// The edges of its pyramid.
    pub fn edges(&self, row: &ContactRow) -> std::ops::Range<usize> {
        self.edge as usize..self.edge as usize + row.edges()
    }
}
