//! What pairs have in common: classes for which one piece of code does, and groups that are tested together.

use super::body::Frames;
use super::bound::nearest_first;
use super::pair::in_lanes;
use super::shapes;
use crate::lane::Scalar;
use crate::model::{Model, NONE, Pair, Shape};

/// Pairs with the same shapes, of which the same moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Class {
    /// Shapes.
    pub shapes: (Shape, Shape),
    /// Whether each geom moves, whether both do in one tree, and whether contacts are placed in the first's.
    moves: ([bool; 2], [bool; 2]),
    /// The first such pair.
    pub pair: u32,
}

impl Class {
    /// That of a pair; `None`: it has no formula in lanes.
    fn new<T>(model: &Model<T>, number: u32, pair: &Pair<T>) -> Option<Self> {
        let (shapes, Frames { trees, reference }) = (shapes(model, number), Frames::new(model, pair));
        let moves = (trees.map(|tree| tree != NONE), [trees[0] == trees[1], trees[0] == reference]);
        in_lanes(shapes).then_some(Class { shapes, moves, pair: number })
    }

    /// Whether some may be parallel, and have code of their own.
    pub fn capsules(&self) -> bool {
        self.shapes == (Shape::Capsule, Shape::Capsule)
    }

    /// What it is.
    pub fn name(&self) -> String {
        let (first, second) = self.shapes;
        let trees = match self.moves {
            ([true, true], [true, _]) => "in a tree",
            ([true, true], _) => "of two trees",
            _ => "on the ground",
        };
        format!("{first:?} {second:?} {trees}").to_lowercase()
    }
}

/// The classes of a model's pairs, and the number of each pair's; [`NONE`]: it has no formula in lanes.
pub fn classes<T>(model: &Model<T>) -> (Vec<Class>, Vec<u32>) {
    let mut classes: Vec<Class> = vec![];
    let class = |(number, pair): (u32, &Pair<T>)| {
        let Some(class) = Class::new(model, number, pair) else { return NONE };
        let alike = |known: &Class| known.shapes == class.shapes && known.moves == class.moves;
        let known = classes.iter().position(alike);
        known.unwrap_or_else(|| {
            classes.push(class);
            classes.len() - 1
        }) as u32
    };
    let of_pairs = (0..).zip(&model.pairs).map(class).collect();
    (classes, of_pairs)
}

/// Most pairs that are all tested in groups. Of more, most are far from each other, and are passed over one by one.
const MOST_PAIRS: usize = 1000;
/// Pairs of the first group; each group has twice as many as the one before.
const FIRST_GROUP: usize = 16;

/// Groups of pairs that are tested together, those first that are nearest in the reference configuration; none if there are
/// too many pairs.
pub fn groups<T: Scalar>(model: &Model<T>) -> Vec<Vec<u32>> {
    let order = if model.pairs.len() > MOST_PAIRS { vec![] } else { nearest_first(model) };
    let (mut rest, mut size) = (&order[..], FIRST_GROUP);
    let mut groups = vec![];
    while !rest.is_empty() {
        let (pairs, later) = rest.split_at(size.min(rest.len()));
        let mut pairs = pairs.to_vec();
        pairs.sort_unstable();
        groups.push(pairs);
        (rest, size) = (later, 2 * size);
    }
    groups
}
