//! Exact derivatives: of every world around its nominal state, eight worlds side by side in double precision.

use lanesim_kernels::exact::{self, Exact, Given, STRIP, Strip};
use lanesim_kernels::lane::{LaneQuery, Real};
use lanesim_kernels::model::{Instance, Model as KernelModel, Varied};
use lanesim_kernels::state::{Applied, State};
use lanesim_kernels::workspace::Workspace;
use wide::f64x8;

use super::{Cloud, Work};
use crate::block::Block;
use crate::convex::SupportCollider;
use crate::rows::Rows;

/// Worlds side by side.
const WIDTH: usize = f64x8::WIDTH;

/// What a thread has for exact derivatives.
#[derive(Debug)]
pub(super) struct Room {
    exact: Exact<f64x8>,
    state: State<f64x8>,
    applied: Option<Applied<f64x8>>,
    varied: Option<Varied<f64x8>>,
    qacc: Vec<f64x8>,
    /// All derivatives, rows first.
    entries: Vec<f64x8>,
}

impl Room {
    fn new(model: &KernelModel<f64>) -> Self {
        let zero = f64x8::from([0.0; WIDTH]);
        Room {
            exact: Exact::new(model),
            state: State::new(&model.sizes),
            applied: None,
            varied: None,
            qacc: vec![zero; model.sizes.nv],
            entries: Vec::new(),
        }
    }

    /// Takes over the worlds in the lanes from `first` on; places that are left repeat the last.
    fn gather<L: LaneQuery>(
        &mut self,
        model: &KernelModel<f64>,
        (first, last): (usize, usize),
        (block, qacc): (&Block<L>, &[L]),
    ) {
        let widen = |from: &[L], to: &mut [f64x8]| {
            for (to, from) in to.iter_mut().zip(from) {
                *to = f64x8::from(std::array::from_fn(|place| from.get((first + place).min(last)).to_f64()));
            }
        };
        (0..State::<L>::COUNT).for_each(|n| widen(block.state.field(n), self.state.field_mut(n)));
        widen(qacc, &mut self.qacc);
        self.applied = block.applied.as_ref().map(|applied| {
            let mut own = Applied::new(&model.sizes);
            (0..Applied::<L>::COUNT).for_each(|n| widen(applied.field(n), own.field_mut(n)));
            own
        });
        self.varied = block.varied.as_ref().map(|varied| {
            let mut own = Varied::new(model, varied.set());
            varied.set().iter().for_each(|quantity| widen(varied.lanes(quantity), own.lanes_mut(quantity)));
            own
        });
    }
}

/// Writes a matrix of the worlds, `None` in lanes without a world: its height, width and first column among `entries`, whose rows have a given length.
fn write(
    to: &mut Rows<'_>,
    worlds: [Option<usize>; WIDTH],
    [height, width, first]: [usize; 3],
    (entries, length): (&[f64x8], usize),
) {
    let mut at = worlds.map(|world| world.map(|world| world * height * width));
    for row in entries.chunks_exact(length).take(height) {
        for column in (0..width).step_by(STRIP) {
            let (lanes, count) = (&row[first + column..][..STRIP], STRIP.min(width - column));
            let lanes: Strip<_> = std::array::from_fn(|i| (lanes[i] + f64x8::from([0.0; WIDTH])).to_array());
            let numbers: [[f64; STRIP]; WIDTH] = std::array::from_fn(|place| std::array::from_fn(|i| lanes[i][place]));
            for (at, numbers) in at.iter_mut().zip(&numbers) {
                let Some(at) = at else { continue };
                to.put(*at, numbers, count);
                *at += count;
            }
        }
    }
}

impl<L: LaneQuery> Cloud<L> {
    /// Writes the derivatives of the worlds in the lanes of `alive`, which were evaluated: `workspace` has what was found, and `self` the
    /// accelerations that were given.
    pub(super) fn exact(
        &mut self,
        model: &KernelModel<f64>,
        (work, alive): (&Work<'_>, u32),
        workspace: &Workspace<L>,
        rows: &mut [Rows<'_>],
    ) {
        let of = work.request.of.exact();
        let inverse = of == exact::Of::Inverse;
        let qacc = if inverse { &self.given } else { &workspace.solver.fields.qacc };
        let room = self.exact.get_or_insert_with(|| Box::new(Room::new(model)));
        let count = work.ids.len();
        for first in (0..count).step_by(WIDTH) {
            room.gather(model, (first, count - 1), (&self.block, qacc));
            let Room { exact, state, applied, varied, qacc, entries } = &mut **room;
            let collision = &workspace.collision;
            let given = Given {
                state,
                applied: applied.as_ref().filter(|_| !inverse),
                qacc,
                near: if collision.slots.is_empty() { &[] } else { &collision.near },
                slots: &collision.slots,
                convex: &SupportCollider,
            };
            let instance = Instance { model, varied: varied.as_ref() };
            let lives = |place: usize| alive >> (first + place) & 1 != 0;
            let worlds = std::array::from_fn(|place| work.ids.get(first + place).copied().filter(|_| lives(place)));
            // First all of them in lanes: writing world by world goes at the pace of the memory, and faster without gaps.
            let length = work.shape.all() + STRIP;
            entries.resize(work.shape.height() * length, f64x8::from([0.0; WIDTH]));
            exact.differentiate(of, instance, &given, &mut |column, _, strip| {
                // What a strip has too much is overwritten by the next one, or beyond the last column.
                let all = entries.chunks_exact_mut(length).zip(strip);
                all.for_each(|(row, strip)| row[column..][..STRIP].copy_from_slice(strip));
            });
            for [place, height, width, first] in work.shape.by_columns() {
                write(&mut rows[place], worlds, [height, width, first], (entries, length));
            }
            let edges = exact.edges(model);
            for (place, id) in worlds.into_iter().enumerate().filter_map(|(place, world)| Some((place, world?))) {
                let edges = edges.get(place) as u32;
                (0..work.shape.all()).for_each(|column| work.shape.mark(rows, id, column, [false; 2], edges));
            }
        }
    }
}
