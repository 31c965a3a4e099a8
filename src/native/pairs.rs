//! Code for pairs: bounding tests of all, in groups, and the narrow phase of those that are near, by kind of pair.

use std::sync::OnceLock;

use lanesim_codegen::{FieldSlice, Float, Fragment, InstructionSet, Program, Recorder, Scratch};
use lanesim_kernels::collision::{Body, Found, Frames, Near, capsules, in_lanes, near_pairs, nearest_first, points};
use lanesim_kernels::lane::{Lane, LaneQuery, Mask};
use lanesim_kernels::model::{Model, NONE, Pair, Shape, Sizes};
use lanesim_kernels::position::Position;

use super::parts::Binder;

/// Most pairs that are all tested by straight-line code. Of more, most are far from each other, and kernels pass them over
/// one by one.
const MOST_PAIRS: usize = 600;
/// Pairs of the first group; each group has twice as many as the one before.
const FIRST_GROUP: usize = 16;

/// The bounding tests of all pairs; no groups: kernels test them.
pub struct NearCode<T> {
    pub groups: Vec<Group<T>>,
}

/// Pairs that are tested together.
pub struct Group<T> {
    pairs: Vec<u32>,
    pub fragment: Fragment<T>,
}

impl<T: Float> NearCode<T> {
    /// Makes the code.
    pub fn new(model: &Model<T>, isa: InstructionSet) -> Self {
        if model.pairs.len() > MOST_PAIRS {
            return NearCode { groups: vec![] };
        }
        let order = nearest_first(model);
        let (mut rest, mut size) = (&order[..], FIRST_GROUP);
        let mut groups = vec![];
        while !rest.is_empty() {
            let (pairs, later) = rest.split_at(size.min(rest.len()));
            let mut pairs = pairs.to_vec();
            pairs.sort_unstable();
            let Ok(fragment) = record_near(model, &pairs).compile(isa) else { return NearCode { groups: vec![] } };
            let fragment = fragment.named(&format!("near {}", groups.len()));
            groups.push(Group { pairs, fragment });
            (rest, size) = (later, 2 * size);
        }
        NearCode { groups }
    }
}

/// Fields: origins of trees, positions and orientations of links; gaps. Masks: where the pairs are near.
fn record_near<T: Float>(model: &Model<T>, pairs: &[u32]) -> Program<T> {
    let mut binder = Binder::new();
    let mut position = Position::new(&model.sizes);
    binder.input(position.origin.as_flattened_mut());
    binder.input(position.pos.as_flattened_mut());
    binder.input(position.rot.as_flattened_mut());
    let mut near = vec![];
    let gaps = near_pairs(model, &position, pairs, &mut near);
    binder.recording.output(binder.next, &gaps);
    for mask in near {
        binder.recording.mask_output(mask);
    }
    binder.recording.finish()
}

impl<T: Float> Group<T> {
    /// Runs it: writes where its pairs are near in the worlds of `alive`, and the gaps. Whether any is.
    pub fn run(
        &self,
        scratch: &mut Scratch,
        words: &mut Vec<u32>,
        position: &Position<T::Block>,
        alive: u32,
        near: &mut [u32],
        gaps: &mut [T::Block; 2],
    ) -> bool {
        words.resize(words.len().max(self.pairs.len()), 0);
        let words = &mut words[..self.pairs.len()];
        let mut fields = [
            FieldSlice::read(position.origin.as_flattened()),
            FieldSlice::read(position.pos.as_flattened()),
            FieldSlice::read(position.rot.as_flattened()),
            FieldSlice::write(gaps),
        ];
        self.fragment.run(scratch, &mut fields, &[], words);
        let mut any = 0;
        for (p, worlds) in self.pairs.iter().zip(words) {
            near[*p as usize] = *worlds & alive;
            any |= *worlds;
        }
        any & alive != 0
    }
}

/// What the code of a pair's narrow phase depends on.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Kind {
    shapes: (Shape, Shape),
    /// Trees by the geom whose they are.
    frames: Frames,
}

impl Kind {
    fn new<T: Float>(model: &Model<T>, pair: &Pair<T>) -> Option<Self> {
        let shapes = (model.geoms[pair.geom1 as usize].shape, model.geoms[pair.geom2 as usize].shape);
        let frames = Frames::new(model, pair);
        let [first, second] = frames.trees;
        let frames = match (first, second) {
            (NONE, NONE) => frames,
            (NONE, _) => Frames { trees: [NONE, 1], reference: 1 },
            (_, NONE) => Frames { trees: [0, NONE], reference: 0 },
            _ if first == second => Frames { trees: [0, 0], reference: 0 },
            _ => Frames { trees: [0, 1], reference: 1 },
        };
        in_lanes(shapes).then_some(Kind { shapes, frames })
    }

    fn capsules(&self) -> bool {
        self.shapes == (Shape::Capsule, Shape::Capsule)
    }

    fn name(&self) -> String {
        let (first, second) = self.shapes;
        let trees = match self.frames.trees {
            [0, 0] => "in a tree",
            [0, 1] => "of two trees",
            _ => "on the ground",
        };
        format!("narrow {first:?} {second:?} {trees}").to_lowercase()
    }
}

/// Fields of the narrow phase: of each geom position and orientation of its link, origin of its tree, numbers; distance up
/// to which there are contacts; contacts found; where capsules are parallel.
const FIELDS: usize = 11;
/// Numbers of a geom: position, orientation, sizes.
const NUMBERS: usize = 15;

/// Code of a kind.
struct KindCode<T> {
    kind: Kind,
    fragment: OnceLock<Option<Fragment<T>>>,
    /// Of capsules, some of which are parallel.
    parallel: OnceLock<Option<Fragment<T>>>,
}

impl<T: Float> KindCode<T> {
    fn get(&self, parallel: bool, isa: InstructionSet) -> Option<&Fragment<T>> {
        let place = if parallel { &self.parallel } else { &self.fragment };
        let compile = || Some(record_narrow(self.kind, parallel).compile(isa).ok()?.named(&self.kind.name()));
        place.get_or_init(compile).as_ref()
    }
}

/// What is known of a pair.
#[derive(Clone, Copy)]
struct Place {
    /// Its kind among the model's; [`NONE`] if it has no formula in lanes.
    kind: u32,
    /// Where its fields start, but for those that are written.
    starts: [u32; FIELDS - 2],
}

/// The narrow phase of all pairs with a formula in lanes.
pub struct NarrowCode<T> {
    kinds: Vec<KindCode<T>>,
    pairs: Vec<Place>,
    geoms: Vec<T>,
    include: Vec<T>,
}

impl<T: Float> NarrowCode<T> {
    /// Nothing compiled yet.
    pub fn new(model: &Model<T>) -> Self {
        let mut kinds: Vec<KindCode<T>> = vec![];
        let mut place = |(p, pair): (usize, &Pair<T>)| {
            let kind = Kind::new(model, pair).map_or(NONE, |kind| {
                let known = kinds.iter().position(|code| code.kind == kind);
                known.unwrap_or_else(|| {
                    kinds.push(KindCode { kind, fragment: OnceLock::new(), parallel: OnceLock::new() });
                    kinds.len() - 1
                }) as u32
            });
            let [first, second] = [(pair.geom1, pair.link1), (pair.geom2, pair.link2)].map(|(geom, link)| {
                let [link, tree] = if link == NONE { [0; 2] } else { [link, model.links[link as usize].tree] };
                [3 * link, 9 * link, 3 * tree, NUMBERS as u32 * geom]
            });
            let mut starts = [p as u32; FIELDS - 2];
            starts[..4].copy_from_slice(&first);
            starts[4..8].copy_from_slice(&second);
            Place { kind, starts }
        };
        let pairs = model.pairs.iter().enumerate().map(&mut place).collect();
        let numbers = model.geoms.iter().flat_map(|geom| geom.pos.into_iter().chain(geom.rot).chain(geom.size));
        let geoms = numbers.collect();
        NarrowCode { kinds, pairs, geoms, include: model.pairs.iter().map(|pair| pair.include).collect() }
    }

    /// The code of all kinds, by name.
    pub fn parts(&self, isa: InstructionSet) -> impl Iterator<Item = (String, Option<&Fragment<T>>)> {
        self.kinds.iter().flat_map(move |code| {
            let name = code.kind.name();
            let parallel = code.kind.capsules().then(|| (format!("{name}, parallel"), code.get(true, isa)));
            std::iter::once((name, code.get(false, isa))).chain(parallel)
        })
    }

    /// Finds the contacts of the pairs in `near` that have a formula in lanes; not, if some code cannot be had.
    pub fn run(
        &self,
        isa: InstructionSet,
        scratch: &mut Scratch,
        parallel: &mut Vec<T::Block>,
        position: &Position<T::Block>,
        near: &[Near],
        found: &mut [Found<T::Block>],
    ) -> bool {
        if parallel.len() < near.len() {
            parallel.resize(near.len(), T::Block::zero());
        }
        for (k, code) in self.kinds.iter().enumerate() {
            let mine = near.iter().enumerate().filter(|(_, near)| self.pairs[near.pair as usize].kind == k as u32);
            if mine.clone().next().is_none() {
                continue;
            }
            let Some(fragment) = code.get(false, isa) else { return false };
            self.run_kind(fragment, scratch, parallel, position, mine.clone(), found);
            if !code.kind.capsules() {
                continue;
            }
            for one in mine {
                if !T::Block::any(parallel[one.0].gt(T::Block::zero())) {
                    continue;
                }
                let Some(fragment) = code.get(true, isa) else { return false };
                self.run_kind(fragment, scratch, parallel, position, std::iter::once(one), found);
            }
        }
        true
    }

    fn run_kind<'a>(
        &self,
        fragment: &Fragment<T>,
        scratch: &mut Scratch,
        parallel: &mut [T::Block],
        position: &Position<T::Block>,
        near: impl Iterator<Item = (usize, &'a Near)> + Clone,
        found: &mut [Found<T::Block>],
    ) {
        let lent = || {
            let pose = [&position.pos.as_flattened(), &position.rot.as_flattened(), &position.origin.as_flattened()];
            pose.map(|field| FieldSlice::read(field))
        };
        let ([pos1, rot1, origin1], [pos2, rot2, origin2]) = (lent(), lent());
        let [first, second] = [FieldSlice::uniform(&self.geoms), FieldSlice::uniform(&self.geoms)];
        let include = FieldSlice::uniform(&self.include);
        let (found, parallel) = (FieldSlice::write(found.as_flattened_mut()), FieldSlice::write(parallel));
        let mut fields = [pos1, rot1, origin1, first, pos2, rot2, origin2, second, include, found, parallel];
        let items = near.map(|(i, near)| {
            let place = &self.pairs[near.pair as usize].starts;
            let mut starts = [0; FIELDS];
            starts.iter_mut().zip(place).for_each(|(start, place)| *start = *place as usize);
            starts[FIELDS - 2] = 13 * near.first as usize;
            starts[FIELDS - 1] = i;
            (starts, near.worlds)
        });
        fragment.run_each_masked(scratch, &mut fields, items);
    }
}

/// Number of contacts that a pair of the shapes can have.
fn most((first, second): (Shape, Shape)) -> usize {
    match (first, second) {
        (Shape::Plane | Shape::Capsule, Shape::Capsule) => 2,
        (Shape::Plane, Shape::Cylinder | Shape::Box) => 4,
        _ => 1,
    }
}

/// Fields: see [`FIELDS`]. Mask: where the pair is near. `parallel`: of capsules that may be.
fn record_narrow<T: Float>(kind: Kind, parallel: bool) -> Program<T> {
    let mut binder = Binder::<T>::new();
    let mut position = Position::<Recorder<T>>::new(&Sizes { ntree: 2, nlink: 2, ..Sizes::default() });
    let bodies: [Body<Recorder<T>>; 2] = std::array::from_fn(|k| {
        let moves = kind.frames.trees[k] != NONE;
        let mut field = |lanes: &mut [Recorder<T>]| {
            if moves {
                binder.input(lanes);
            } else {
                binder.next += 1;
            }
        };
        field(&mut position.pos[k]);
        field(&mut position.rot[k]);
        field(&mut position.origin[k]);
        let numbers = binder.recording.uniform(binder.next, NUMBERS);
        binder.next += 1;
        let at = |i: usize| numbers[i];
        let own = Body {
            pos: std::array::from_fn(at),
            rot: std::array::from_fn(|i| at(3 + i)),
            size: std::array::from_fn(|i| at(12 + i)),
        };
        if moves { own.carried(&position.pos[k], &position.rot[k]) } else { own }
    });
    let [a, b] = kind.frames.place(&position, bodies);
    let include = binder.recording.uniform(binder.next, 1)[0];
    let near = binder.recording.mask_input();
    let mut found = vec![[Recorder::zero(); 13]; most(kind.shapes)];
    let alongside = if parallel {
        capsules(&a, &b, include, near, &mut found);
        Mask::splat(false)
    } else {
        points(kind.shapes, &a, &b, include, near, &mut found)
    };
    binder.recording.output(FIELDS - 2, found.as_flattened());
    let flag = Recorder::select(alongside, Recorder::one(), Recorder::zero());
    binder.recording.output(FIELDS - 1, &[flag]);
    binder.recording.finish()
}
