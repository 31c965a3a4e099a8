//! Newton's direction where many trees can touch: every world of a block factors its own Hessian, on the pattern of its own
//! contacts.
//!
//! Where few trees touch, the Hessian of all worlds of a block has the entries that any of them needs. In a heap every world has
//! other contacts: together they fill most of the matrix, in any order, while each one's own contacts, in an order of its own,
//! fill little. Only the worlds that still iterate are factored.

mod factor;
mod pattern;

use crate::constraint::ContactRow;
use crate::lane::{Lane, LaneQuery};
use crate::model::{Model, Sides, Span};

use self::factor::{Factor, Row, WIDTH};
use super::cone::{self, Stiffness};
use super::hessian::times;
use super::{Problem, SolverWork};

/// Components of a contact, by strips' dofs.
type Components<T> = [Row<T>; 6];

/// The factors of a block's worlds.
#[derive(Clone, Debug)]
pub struct Sparse<L: Lane> {
    worlds: Vec<Factor<L::Real>>,
    /// Of a contact in one world, by strip: J, and K J.
    sides: Vec<[Components<L::Real>; 2]>,
}

impl<L: Lane> Default for Sparse<L> {
    fn default() -> Self {
        Sparse { worlds: vec![], sides: vec![] }
    }
}

/// Factors H, of which `hessian` has what is not from contacts between links that move, and solves for the search direction; in the
/// lanes of `open`.
pub fn direct<L: LaneQuery>(problem: &Problem<'_, L>, rows: &[ContactRow], open: u32, work: &mut SolverWork<L>) {
    let (model, strips) = (problem.model, &problem.model.own.spans);
    work.sparse.worlds.resize_with(L::WIDTH, Factor::default);
    for (lane, world) in of(open, &mut work.sparse.worlds) {
        world.pattern.find(&model, rows, lane);
        world.clear();
        spread(&model, &work.fields.hessian, lane, world);
    }
    for row in rows.iter().filter(|row| row.sides != Sides::One && row.lanes & open != 0) {
        couple(problem, row, open, work);
    }
    of(open, &mut work.sparse.worlds).for_each(|(_, world)| world.factor(strips));
    solve(problem, open, work);
}

/// The search direction from the factors at hand, in the lanes of `open`.
pub fn solve<L: LaneQuery>(problem: &Problem<'_, L>, open: u32, work: &mut SolverWork<L>) {
    let strips = &problem.model.own.spans;
    let SolverWork { sparse, fields, .. } = work;
    for (lane, world) in of(open, &mut sparse.worlds) {
        for (strip, x) in world.pattern.order.iter().zip(&mut world.x) {
            *x = Row::default();
            for (x, dof) in x.iter_mut().zip(strips[*strip as usize].range()) {
                *x = -fields.gradient[dof].get(lane);
            }
        }
        world.solve(strips);
        for (strip, x) in world.pattern.order.iter().zip(&world.x) {
            for (x, dof) in x.iter().zip(strips[*strip as usize].range()) {
                fields.search[dof].set(lane, *x);
            }
        }
    }
}

/// The worlds of some lanes.
fn of<T>(lanes: u32, worlds: &mut [Factor<T>]) -> impl Iterator<Item = (usize, &mut Factor<T>)> {
    worlds.iter_mut().enumerate().filter(move |(lane, _)| lanes >> lane & 1 != 0)
}

/// Takes a world's entries between ancestors.
fn spread<L: LaneQuery>(model: &Model<L::Real>, hessian: &[L], lane: usize, world: &mut Factor<L::Real>) {
    let strips = &model.own;
    let Factor { pattern, own, others, .. } = world;
    for (i, strip) in (0..).zip(&strips.spans) {
        let (place, ..) = pattern.block([i, i]);
        for (n, dof) in strip.range().enumerate() {
            let entry = |column: usize| hessian[model.rows.at(dof, column)].get(lane);
            for (m, column) in (strip.start as usize..=dof).enumerate() {
                own[place as usize][n][m] = entry(column);
            }
            for column in model.tree_pattern.row(strip.start as usize).iter().flat_map(|run| run.range()) {
                let j = strips.of(column as u32);
                let m = column - strips.spans[j as usize].start as usize;
                if let (_, Some(block), straight) = pattern.block([i, j]) {
                    let (r, c) = if straight { (n, m) } else { (m, n) };
                    others[block][r][c] = entry(column);
                }
            }
        }
    }
}

/// H += Jᵀ K J of a contact, in the lanes of `open`.
fn couple<L: LaneQuery>(problem: &Problem<'_, L>, row: &ContactRow, open: u32, work: &mut SolverWork<L>) {
    let (model, constraint) = (problem.model, problem.constraint);
    let SolverWork { sparse: Sparse { worlds, sides }, y, .. } = work;
    let stiffness = cone::stiffness(constraint.law(row), &y.component[row.components()]);
    let dofs = &model.pair_dofs[model.pairs[row.pair as usize].dofs.range()];
    let (strips, dim) = (&model.own, row.dim as usize);
    let jacobian = constraint.jacobian_of(row, dofs.len());
    for (lane, world) in of(open & row.lanes, worlds) {
        let stiffness = stiffness.of(lane);
        sides.clear();
        for (strip, run) in strips.runs(dofs) {
            let mut side = [Components::default(); 2];
            let start = (dofs[run.start as usize].dof - strips.spans[strip as usize].start) as usize;
            for (n, column) in jacobian.chunks_exact(dim).skip(run.start as usize).take(run.len as usize).enumerate() {
                let mut own = [L::Real::default(); 6];
                for (own, j) in own.iter_mut().zip(column) {
                    *own = j.get(lane);
                }
                let scaled = times(&stiffness, &own[..dim]);
                for d in 0..dim {
                    (side[0][d][start + n], side[1][d][start + n]) = (own[d], scaled[d]);
                }
            }
            sides.push(side);
        }
        for (a, (i, _)) in strips.runs(dofs).enumerate() {
            for (b, (j, _)) in strips.runs(dofs).take(a + 1).enumerate() {
                let (place, block, straight) = world.pattern.block([i, j]);
                let target = match block {
                    Some(block) => &mut world.others[block],
                    None => &mut world.own[place as usize],
                };
                // Rows of the one that is eliminated first.
                let (rows, columns) =
                    if straight { (&sides[a][1], &sides[b][0]) } else { (&sides[b][0], &sides[a][1]) };
                add(rows, columns, dim, target);
            }
        }
    }
}

/// block += Rᵀ C over so many components.
fn add<T: Lane>(rows: &Components<T>, columns: &Components<T>, dim: usize, block: &mut factor::Block<T>) {
    for (r, row) in block.iter_mut().enumerate() {
        for d in 0..dim.min(6) {
            let factor = rows[d][r];
            for c in 0..WIDTH {
                row[c] = factor.mul_add(columns[d][c], row[c]);
            }
        }
    }
}

impl<L: LaneQuery> Stiffness<L> {
    /// That of a lane.
    fn of(&self, lane: usize) -> Stiffness<L::Real> {
        match self {
            Stiffness::Arrow(normal, side, cross) => {
                Stiffness::Arrow(normal.get(lane), side.map(|x| x.get(lane)), cross.map(|x| x.get(lane)))
            }
            Stiffness::Full(k) => Stiffness::Full(k.map(|row| row.map(|x| x.get(lane)))),
        }
    }
}

/// Bytes of the factors of a block of a model, if contacts couple as many strips as is usual in a heap.
pub fn bytes<T>(model: &Model<T>, lanes: usize) -> usize {
    /// Blocks for each strip, with what elimination fills in.
    const USUAL: usize = 24;
    let strips: &[Span] = &model.own.spans;
    strips.len() * USUAL * size_of::<factor::Block<T>>() * lanes
}
