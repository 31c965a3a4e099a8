//! What of a model's matrices is the same in every world: code for the solver need not read it, and leaves out what is zero.

use lanesim_codegen::{Float, Recorder};
use lanesim_kernels::inertia::{self, Inertia};
use lanesim_kernels::model::{Instance, Model, Quantities};
use lanesim_kernels::position::{self, Position};
use lanesim_kernels::state::State;

use super::parts::Binder;

/// Entries that do not depend on the state.
pub struct Structure<T> {
    /// Of the dof axes, flat.
    pub axes: Vec<Option<T>>,
    /// Of the inertia matrix.
    pub inertia: Vec<Option<T>>,
    /// Components of motions that some link can have: three in a planar model.
    pub live: [bool; 6],
}

impl<T: Float> Structure<T> {
    /// That of a model too large to record: nothing is known.
    pub fn unknown() -> Self {
        Structure { axes: Vec::new(), inertia: Vec::new(), live: [true; 6] }
    }

    /// That of a model, by computing axes and inertias with positions that are not known, nor what varies.
    pub fn new(model: &Model<T>, varying: Quantities) -> Self {
        let mut binder = Binder::new();
        let mut state = State::<Recorder<T>>::new(&model.sizes);
        binder.input(&mut state.qpos);
        let mut position = Position::new(&model.sizes);
        let mut inertia = Inertia::new(&model.sizes);
        let varied = binder.varied(model, varying);
        let instance = Instance { model, varied: varied.as_ref() };
        position::kinematics(instance, &state.qpos, &mut position);
        inertia::crb(instance, &position, &mut inertia);
        let known = |lanes: &[Recorder<T>]| lanes.iter().map(|lane| lane.constant()).collect::<Vec<_>>();
        let axes = known(position.cdof.as_flattened());
        let inertia = known(&inertia.m);
        binder.recording.finish();
        let still = |x: &Option<T>| x.is_some_and(|x| x.to_f64() == 0.0);
        let live = std::array::from_fn(|c| !axes.iter().skip(c).step_by(6).all(still));
        Structure { axes, inertia, live }
    }
}

/// Replaces the lanes that are known.
pub fn fill_in<T: Float>(lanes: &mut [Recorder<T>], known: &[Option<T>]) {
    for (lane, known) in lanes.iter_mut().zip(known) {
        if let Some(x) = known {
            *lane = lanesim_kernels::lane::Lane::splat(*x);
        }
    }
}
