//! Newton's factor by [tiles](crate::model::Tiles). Rows are eliminated from last to first as by [`ldl`](crate::math::ldl), every entry
//! sees the same subtractions in the same order, and tiles that are not there would be zero: the bits are the same.

use super::cone;
use super::hessian::times;
use super::{Problem, Solver, SolverWork};
use crate::constraint::ContactRow;
use crate::lane::Lane;
use crate::math::ldl::least_pivot;
use crate::model::{Patch, Span};

/// A tile and what it is worked on with. Spans of length 0 are not there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tile {
    /// The tile that is changed, or by which a vector is.
    pub target: Span,
    /// Another tile.
    pub source: Span,
    /// Multipliers: rows of the source over their pivots, by the target's rows.
    pub panel: Span,
    /// Dofs of the strip that is eliminated, and of the other.
    pub dofs: [Span; 2],
}

/// Numbers of a field.
#[inline(always)]
fn of<L>(field: &[L], span: Span) -> &[L] {
    &field[span.range()]
}

/// The Hessian's entries between ancestors become tiles.
pub fn spread<L: Lane>(problem: &Problem<'_, L>, work: &mut SolverWork<L>) {
    let model = problem.model;
    let tiles = &model.tiles;
    let Solver { hessian, tiles: entries, .. } = &mut work.fields;
    let columns = || tiles.strips.iter().enumerate();
    for (i, rows) in columns() {
        for (r, row) in rows.range().enumerate() {
            let has = |column: usize| model.tree_pattern.row(row).iter().any(|run| run.range().contains(&column));
            for (j, strip) in columns().take(i + 1).filter(|(j, strip)| *j == i || has(strip.start as usize)) {
                let start = tiles.start(i, j) as usize + r * strip.len as usize;
                let columns = strip.range().take_while(|column| *column <= row);
                for (entry, column) in entries[start..].iter_mut().zip(columns) {
                    *entry = hessian[model.rows.at(row, column)];
                }
            }
        }
    }
}

/// H += Jᵀ K J of a contact on a tile.
#[inline(always)]
pub fn couple_tile<L: Lane>(problem: &Problem<'_, L>, row: &ContactRow, patch: &Patch, work: &mut SolverWork<L>) {
    let constraint = problem.constraint;
    let (y, dim) = (&work.y.component[row.components()], row.dim as usize);
    let k = cone::stiffness(constraint.law(row), y);
    let columns = |span: Span| {
        let start = row.jacobian as usize + dim * span.start as usize;
        constraint.jacobian[start..][..dim * span.len as usize].chunks_exact(dim)
    };
    let target = &mut work.fields.tiles[patch.target as usize..][..patch.extent()];
    for (n, column) in columns(patch.rows).enumerate() {
        let scaled = times(&k, column);
        let count = if patch.diagonal() { n + 1 } else { patch.columns.len as usize };
        for (entry, column) in target[n * patch.stride as usize..].iter_mut().zip(columns(patch.columns)).take(count) {
            for (k, j) in scaled.iter().zip(column) {
                *entry = k.mul_add(*j, *entry);
            }
        }
    }
}

/// Makes a tile zero.
#[inline(always)]
pub fn clear<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    solver.tiles[tile.target.range()].fill(L::zero());
}

/// The least pivots, in `multipliers`, and the gradient's negative, in `search`.
pub fn aim<L: Lane>(problem: &Problem<'_, L>, solver: &mut Solver<L>) {
    let tables = &problem.model.tiles;
    let Solver { tiles, multipliers, gradient, search, .. } = solver;
    for (s, strip) in tables.strips.iter().enumerate() {
        let (start, len) = (tables.start(s, s) as usize, strip.len as usize);
        for (n, dof) in strip.range().enumerate() {
            multipliers[dof] = least_pivot(tiles[start + n * (len + 1)]);
            search[dof] = -gradient[dof];
        }
    }
}

/// Factors a strip's own tile.
#[inline(always)]
pub fn pivot<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    let Solver { tiles, inverse, multipliers, .. } = solver;
    let n = tile.dofs[0].len as usize;
    let target = &mut tiles[tile.target.range()];
    let inverse = &mut inverse[tile.dofs[0].range()];
    let least = of(multipliers, tile.dofs[0]);
    for i in (0..n).rev() {
        for k in (i + 1..n).rev() {
            let l = target[k * n + i] * inverse[k];
            for j in 0..=i {
                target[i * n + j] = l.neg_mul_add(target[k * n + j], target[i * n + j]);
            }
        }
        let found = target[i * n + i];
        let pivot = L::select(found.ge(least[i]), found, least[i]);
        target[i * n + i] = pivot;
        inverse[i] = L::one() / pivot;
    }
}

/// Finishes the rows of a strip in another tile, and divides them by their pivots.
#[inline(always)]
pub fn panel<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    let Solver { tiles, panel, inverse, .. } = solver;
    let [n, columns] = tile.dofs.map(|dofs| dofs.len as usize);
    let inverse = of(inverse, tile.dofs[0]);
    for i in (0..n).rev() {
        for k in (i + 1..n).rev() {
            let l = tiles[tile.source.start as usize + k * n + i] * inverse[k];
            let (target, source) = (tile.target.start as usize + i * columns, tile.target.start as usize + k * columns);
            for j in 0..columns {
                tiles[target + j] = l.neg_mul_add(tiles[source + j], tiles[target + j]);
            }
        }
    }
    for k in 0..n {
        for j in 0..columns {
            panel[tile.panel.start as usize + k * columns + j] =
                tiles[tile.target.start as usize + k * columns + j] * inverse[k];
        }
    }
}

/// Subtracts what eliminating a strip leaves of a tile of two others; of one with itself, in the lower half.
#[inline(always)]
pub fn eliminate<L: Lane>(tile: &Tile, diagonal: bool, solver: &mut Solver<L>) {
    let Solver { tiles, panel, .. } = solver;
    let [n, columns] = tile.dofs.map(|dofs| dofs.len as usize);
    let rows = tile.panel.len as usize / n;
    let [target, source, panel_start] = [tile.target, tile.source, tile.panel].map(|span| span.start as usize);
    for i in 0..rows {
        for j in 0..if diagonal { i + 1 } else { columns } {
            let mut sum = tiles[target + i * columns + j];
            for k in (0..n).rev() {
                sum = panel[panel_start + k * rows + i].neg_mul_add(tiles[source + k * columns + j], sum);
            }
            tiles[target + i * columns + j] = sum;
        }
    }
}

/// Of L⁻ᵀ x, a strip's own part; begins its sums.
#[inline(always)]
pub fn forward<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    let Solver { tiles, inverse, search, multipliers, .. } = solver;
    let n = tile.dofs[0].len as usize;
    let (source, inverse) = (of(tiles, tile.source), of(inverse, tile.dofs[0]));
    let x = &mut search[tile.dofs[0].range()];
    for k in (0..n).rev() {
        let y = x[k] * inverse[k];
        x[k] = y;
        for j in 0..k {
            x[j] = y.neg_mul_add(source[k * n + j], x[j]);
        }
    }
    multipliers[tile.dofs[0].range()].fill(L::zero());
}

/// What that takes from another strip.
#[inline(always)]
pub fn forward_tile<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    let Solver { tiles, search, .. } = solver;
    let [own, other] = tile.dofs;
    let columns = other.len as usize;
    for k in (0..own.len as usize).rev() {
        let y = search[own.start as usize + k];
        for j in 0..columns {
            let x = &mut search[other.start as usize + j];
            *x = y.neg_mul_add(tiles[tile.source.start as usize + k * columns + j], *x);
        }
    }
}

/// Adds to a strip's sums what another gives.
#[inline(always)]
pub fn backward_tile<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    let Solver { tiles, search, multipliers, .. } = solver;
    let [own, other] = tile.dofs;
    let columns = other.len as usize;
    for k in 0..own.len as usize {
        let sum = &mut multipliers[own.start as usize + k];
        for j in 0..columns {
            let u = tiles[tile.source.start as usize + k * columns + j];
            *sum = search[other.start as usize + j].mul_add(u, *sum);
        }
    }
}

/// Of the solution, a strip's own part.
#[inline(always)]
pub fn backward<L: Lane>(tile: &Tile, solver: &mut Solver<L>) {
    let Solver { tiles, inverse, search, multipliers, .. } = solver;
    let n = tile.dofs[0].len as usize;
    let (source, inverse) = (of(tiles, tile.source), of(inverse, tile.dofs[0]));
    let (x, sums) = (&mut search[tile.dofs[0].range()], of(multipliers, tile.dofs[0]));
    for k in 0..n {
        let sum = (0..k).fold(sums[k], |sum, j| x[j].mul_add(source[k * n + j], sum));
        x[k] = sum.neg_mul_add(inverse[k], x[k]);
    }
}
