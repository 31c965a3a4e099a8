//! What a part is run for one by one, and where that has its entries in the fields.

use crate::collision::Near;
use crate::constraint::{ContactRow, first_dof};
use crate::model::{Model, NONE, Patch, Quantity, Sides, Span};
use crate::solver::{Tile, Whitened};

use super::step::Name;

/// What a part is run for.
#[derive(Clone, Copy, Debug)]
pub enum Item<'a> {
    /// The block as a whole.
    Whole,
    /// A pair of geoms that is near in some world.
    Near(&'a Near),
    /// A contact.
    Row(&'a ContactRow),
    /// A tile of the Hessian.
    Tile(&'a Tile),
    /// A contact, and a tile to which it adds.
    Patch(&'a ContactRow, &'a Patch),
    /// A contact, and where its whitened rows are.
    Whitened(&'a ContactRow, &'a Whitened),
}

/// Number of columns: of starts of an item's windows.
pub const COLUMNS: usize = 13;
/// Number of those at which parts of the iteration look for contacts with sides in one tree.
pub const KIND_COLUMNS: usize = 6;

/// Where the windows of an item start, by column.
pub type Starts = [usize; COLUMNS];

/// A window into a field: column that says where it starts, and number of entries.
pub type Window = (usize, usize);

/// Most windows of an item into one field.
pub const WINDOWS: usize = 2;

impl Item<'_> {
    /// The pair, if it is of one.
    pub fn pair(&self) -> Option<u32> {
        match self {
            Item::Whole | Item::Tile(_) => None,
            Item::Near(near) => Some(near.pair),
            Item::Row(row) | Item::Patch(row, _) | Item::Whitened(row, _) => Some(row.pair),
        }
    }

    /// Worlds in which there is something to do.
    pub fn worlds(&self) -> u32 {
        match self {
            Item::Near(near) => near.worlds,
            Item::Whole | Item::Row(_) | Item::Tile(_) | Item::Patch(..) | Item::Whitened(..) => u32::MAX,
        }
    }

    /// Where its windows start, by column. Those of an element's numbers that `width` worlds share start at whole blocks of as
    /// many numbers, and are counted in blocks.
    #[inline(always)]
    pub fn starts<T>(&self, model: &Model<T>, width: usize) -> Starts {
        let shared = |quantity: Quantity, i: u32| stride(quantity, width) * i as usize;
        match self {
            Item::Whole => [0; COLUMNS],
            Item::Tile(Tile { target, source, panel, dofs: [own, other] }) => {
                columns([target.start, source.start, panel.start, own.start, other.start, 0])
            }
            Item::Patch(row, patch) => {
                let [rows, of_columns] = [patch.rows, patch.columns].map(|run| row.jacobian + row.dim * run.start);
                columns([7 * row.strength, patch.target, row.component, rows, of_columns, 0])
            }
            Item::Whitened(row, place) => {
                let [first, second] = place.windows.map(|window| window.start);
                columns([7 * row.strength, row.component, place.start, first, second, place.edge])
            }
            Item::Near(near) => {
                let pair = &model.pairs[near.pair as usize];
                let [[pos1, rot1, origin1], [pos2, rot2, origin2]] = pair.geoms().map(|geom| {
                    let link = model.geoms[geom].link;
                    let [link, tree] = if link == NONE { [0; 2] } else { [link, model.links[link as usize].tree] };
                    [3 * link as usize, 9 * link as usize, 3 * tree as usize]
                });
                let [geom1, geom2] = [pair.geom1, pair.geom2].map(|geom| shared(Quantity::Geom, geom) / width);
                let first = near.first as usize;
                let include = shared(Quantity::Include, near.pair) / width;
                [pos1, rot1, origin1, geom1, pos2, rot2, origin2, geom2, include, 13 * first, first, 0, 0]
            }
            Item::Row(row) => {
                let law = shared(Quantity::Law, row.pair) / width;
                let [strength, component, jacobian, place, pair] =
                    [row.strength, row.component, row.jacobian, row.place, row.pair].map(|x| x as usize);
                let [first, second, extent, dof, trees @ ..] = sides(row, model);
                [
                    7 * strength,
                    6 * component,
                    component,
                    first,
                    second,
                    extent,
                    jacobian,
                    13 * place,
                    law,
                    Quantity::Grip.width() * pair,
                    dof,
                    trees[0],
                    trees[1],
                ]
            }
        }
    }

    /// Its windows into a field; none: it sees all of the field.
    pub fn windows<T>(&self, model: &Model<T>, [stage, name]: Name) -> Vec<Window> {
        let quantity = |quantity: Quantity, column: usize| vec![(column, quantity.width())];
        let spans = |windows: &[(usize, Span)]| {
            let there = windows.iter().filter(|(_, span)| span.len > 0);
            there.map(|(column, span)| (*column, span.len as usize)).collect()
        };
        match (self, stage, name) {
            (Item::Tile(Tile { target, source, panel, dofs: [own, other] }), ..) => match (stage, name) {
                ("solver", "tiles") => spans(&[(0, *target), (1, *source)]),
                ("solver", "panel") => spans(&[(2, *panel)]),
                ("solver", "inverse" | "multipliers") => spans(&[(3, *own)]),
                ("solver", "search") if own != other => spans(&[(3, *own), (4, *other)]),
                ("solver", "search") => spans(&[(3, *own)]),
                _ => vec![],
            },
            (Item::Patch(row, patch), ..) => match (stage, name) {
                ("constraint", "strengths") => vec![(0, 7)],
                ("solver", "tiles") => vec![(1, patch.extent())],
                ("solver", "y.component") => vec![(2, row.dim as usize)],
                ("constraint", "jacobian") => {
                    let of = [(3, patch.rows), (4, patch.columns)].into_iter().take(2 - usize::from(patch.diagonal()));
                    of.map(|(column, run)| (column, (row.dim * run.len) as usize)).collect()
                }
                _ => vec![],
            },
            (Item::Whitened(row, place), ..) => match (stage, name) {
                ("constraint", "strengths") => vec![(0, 7)],
                ("solver", "bias.component" | "force.component") => vec![(1, row.dim as usize)],
                ("solver", "contacts") => vec![(2, place.block(row).end - place.start as usize)],
                ("solver", "z") => spans(&[(3, place.windows[0]), (4, place.windows[1])]),
                ("solver", "edge_force") if row.edges() > 0 => vec![(5, row.edges())],
                _ => vec![],
            },
            (Item::Near(near), ..) => {
                let pair = &model.pairs[near.pair as usize];
                let moving = |len: usize, columns: [usize; 2]| {
                    let of = pair.geoms().into_iter().zip(columns);
                    of.filter(|(geom, _)| model.geoms[*geom].link != NONE).map(|(_, column)| (column, len)).collect()
                };
                match (stage, name) {
                    ("position", "pos") => moving(3, [0, 4]),
                    ("position", "rot") => moving(9, [1, 5]),
                    ("position", "origin") => moving(3, [2, 6]),
                    ("position", "origin_low") if model.sizes.nlow > 0 => moving(3, [2, 6]),
                    ("varied", "Geom") => vec![(3, 15), (7, 15)],
                    ("varied", "Include") => quantity(Quantity::Include, 8),
                    ("collision", "found") => vec![(9, 13 * near.points as usize)],
                    ("collision", "parallel") => vec![(10, 1)],
                    _ => vec![],
                }
            }
            (Item::Row(row), ..) => {
                let dim = row.dim as usize;
                let dofs = &model.pair_dofs[model.pairs[row.pair as usize].dofs.range()];
                // Of contacts between trees, from the first dof of each side to the last.
                let of_dofs = |width: usize, columns: [usize; 2]| {
                    let side = |second: bool| {
                        let mut all = dofs.iter().filter(|entry| entry.second == second).map(|entry| entry.dof);
                        let first = all.next()?;
                        Some(width * (all.next_back().unwrap_or(first) + 1 - first) as usize)
                    };
                    let windows = columns.into_iter().zip([false, true].map(side));
                    windows.filter_map(|(column, len)| Some((column, len?))).collect()
                };
                let links = || {
                    let other = (row.other != NONE).then_some((4, 6));
                    std::iter::once((3, 6)).chain(other).collect()
                };
                match (stage, name) {
                    ("solver", "search" | "pull") | ("acceleration", "qacc_smooth") | ("state", "qvel")
                        if row.sides == Sides::Apart =>
                    {
                        of_dofs(1, [5, 10])
                    }
                    ("position", "cdof") if row.sides == Sides::Apart => of_dofs(6, [3, 4]),
                    ("position", "origin") if row.sides == Sides::Apart => vec![(11, 3), (12, 3)],
                    ("position", "origin_low") if row.sides == Sides::Apart && model.sizes.nlow > 0 => {
                        vec![(11, 3), (12, 3)]
                    }
                    ("constraint", "strengths") => vec![(0, 7)],
                    ("constraint", "motion") => vec![(1, 6 * dim)],
                    ("constraint", "reference") => vec![(2, dim)],
                    ("solver", "y.component" | "jp.component" | "force.component") => vec![(2, dim)],
                    ("solver", "twist" | "cold_twist" | "wrench") | ("velocity", "cvel")
                        if row.sides != Sides::Apart =>
                    {
                        links()
                    }
                    ("solver", "stiffness") if row.sides != Sides::Apart => vec![(5, 21)],
                    ("constraint", "jacobian") => {
                        vec![(6, dim * dofs.len())]
                    }
                    ("collision", "found") => vec![(7, 13)],
                    ("varied", "Law") => quantity(Quantity::Law, 8),
                    ("varied", "Grip") => quantity(Quantity::Grip, 9),
                    _ => vec![],
                }
            }
            _ => vec![],
        }
    }
}

/// Where the sides of a contact have their entries: motions or dof axes of the first and the second, stiffness or dofs of the
/// first, dofs of the second, and origins of both trees.
#[inline(always)]
fn sides<T>(row: &ContactRow, model: &Model<T>) -> [usize; 6] {
    if row.sides == Sides::Apart {
        let pair = &model.pairs[row.pair as usize];
        let [first, second] = [false, true].map(|side| first_dof(model, pair, side) as usize);
        let trees = [pair.link1, pair.link2].map(|link| 3 * model.links[link as usize].tree as usize);
        return [6 * first, 6 * second, first, second, trees[0], trees[1]];
    }
    let other = if row.other == NONE { 0 } else { row.other };
    [6 * row.link as usize, 6 * other as usize, 21 * row.link as usize, 0, 0, 0]
}

/// The first columns.
#[inline(always)]
fn columns(first: [u32; KIND_COLUMNS]) -> Starts {
    let mut starts = [0; COLUMNS];
    for (start, first) in starts.iter_mut().zip(first) {
        *start = first as usize;
    }
    starts
}

/// Numbers from an element's first to the next one's, of a quantity that worlds share: whole blocks of `width`.
pub const fn stride(quantity: Quantity, width: usize) -> usize {
    quantity.width().div_ceil(width) * width
}
