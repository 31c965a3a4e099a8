//! Code of the parts that read numbers of the model which may vary from world to world, by what varies.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use lanesim_codegen::Float;
use lanesim_kernels::model::{Model, Quantities, Quantity};

use super::Part;
use super::parts::SmoothKind;

/// What the smooth stages read.
pub const SMOOTH: Quantities = Quantities::of(&[
    Quantity::Gravity,
    Quantity::Damping,
    Quantity::Stiffness,
    Quantity::Gain,
    Quantity::Bias,
    Quantity::Gear,
    Quantity::Link,
    Quantity::Compensation,
    Quantity::Armature,
]);
/// What the integration reads.
pub const EULER: Quantities = Quantities::of(&[Quantity::Damping, Quantity::Armature]);

/// What rows on joints read.
pub const JOINTS: Quantities = Quantities::of(&[Quantity::LimitWeight, Quantity::Regulariser]);
/// What the inertia matrix depends on, whose entries that do not depend on the state are part of the solver's code; and what
/// rows on joints and the solver read: where these vary, all code is made anew.
pub const INERTIAL: Quantities =
    JOINTS.or(Quantities::of(&[Quantity::Link, Quantity::Armature, Quantity::MeanInertia]));

/// Those parts for one set of varying quantities. What reads none of them is shared with other sets.
pub struct Readers<T> {
    /// The model, whose structure allows for what varies.
    pub tables: Arc<Model<T>>,
    /// What varies.
    pub set: Quantities,
    /// By [`SmoothKind`]: with forces from outside, and for readers of fields.
    smooth: Arc<[[Part<T>; 2]; 2]>,
    pub euler: Arc<Part<T>>,
}

impl<T: Float> Readers<T> {
    /// Nothing is compiled yet.
    pub fn new(tables: &Arc<Model<T>>, set: Quantities) -> Self {
        let (smooth, euler) = (Arc::default(), Arc::new(OnceLock::new()));
        Readers { tables: tables.clone(), set, smooth, euler }
    }

    /// The smooth stages of a kind.
    pub fn smooth(&self, kind: SmoothKind) -> &Part<T> {
        &self.smooth[usize::from(kind.applied)][usize::from(kind.keep)]
    }
}

/// All that were asked for.
pub struct AllReaders<T> {
    /// Those for the set that the code was made for, of quantities that vary in any case.
    pub first: Arc<Readers<T>>,
    varying: Mutex<Vec<Arc<Readers<T>>>>,
}

impl<T: Float> AllReaders<T> {
    pub fn new(tables: &Arc<Model<T>>, set: Quantities) -> Self {
        AllReaders { first: Arc::new(Readers::new(tables, set)), varying: Mutex::default() }
    }

    /// Those for a set; `tables` is the model whose structure allows for it.
    pub fn get(&self, tables: &Arc<Model<T>>, set: Quantities) -> Arc<Readers<T>> {
        let mut varying = self.varying.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = varying.iter().find(|known| known.set == set) {
            return known.clone();
        }
        let own = Readers::new(tables, set);
        let all = || [&self.first].into_iter().chain(varying.iter());
        let alike = |reads: Quantities| all().find(|known| known.set.and(reads) == set.and(reads));
        let smooth = alike(SMOOTH).map_or(own.smooth, |known| known.smooth.clone());
        let euler = alike(EULER).map_or(own.euler, |known| known.euler.clone());
        let made = Arc::new(Readers { smooth, euler, tables: own.tables, set });
        varying.push(made.clone());
        made
    }
}
