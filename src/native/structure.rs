//! What of a model's matrices is the same in every world: code for the solver need not read it, and leaves out what is zero.

use lanesim_codegen::{Float, Recorder, Recording};
use lanesim_kernels::inertia::{self, Inertia};
use lanesim_kernels::lane::Lane;
use lanesim_kernels::model::{Instance, Model, Quantities, Quantity, Varied};
use lanesim_kernels::part::Name;
use lanesim_kernels::position::{self, Configuration, Position};
use lanesim_kernels::tendon::{self, Tendons};

/// Operations that the kernels take for a link, about.
const PER_LINK: usize = 500;
/// Operations beyond which not even what does not depend on the state is looked for.
const MOST_RECORDED: usize = 1 << 20;

/// Entries that do not depend on the state.
pub struct Structure<T> {
    /// Of the dof axes, flat.
    axes: Vec<Option<T>>,
    /// Of the inertia matrix.
    inertia: Vec<Option<T>>,
    /// Components of motions that some link can have: three in a planar model.
    live: [bool; 6],
    /// What varies of what the entries depend on.
    pub reads: Quantities,
}

impl<T: Float> Structure<T> {
    /// That of a model; of one too large to record, nothing is known.
    pub fn of(model: &Model<T>, varying: Quantities) -> Self {
        let sizes = &model.sizes;
        let small = PER_LINK * sizes.nlink + 10 * sizes.nm <= MOST_RECORDED;
        if small { Self::new(model, varying) } else { Self::unknown() }
    }

    fn unknown() -> Self {
        Structure { axes: Vec::new(), inertia: Vec::new(), live: [true; 6], reads: Quantity::varying() }
    }

    /// That of a model, by computing axes and inertias with positions that are not known, nor what varies.
    fn new(model: &Model<T>, varying: Quantities) -> Self {
        let mut recording = Recording::new();
        let qpos = recording.input(0, model.sizes.nq);
        let mut varied = Varied::<Recorder<T>>::new(model, varying);
        let quantities: Vec<_> = varying.iter().collect();
        for (quantity, field) in quantities.iter().zip(1..) {
            let lanes = varied.lanes_mut(*quantity);
            lanes.copy_from_slice(&recording.input(field, lanes.len()));
        }
        let mut position = Position::new(&model.sizes);
        let mut inertia = Inertia::new(&model.sizes);
        let instance = Instance { model, varied: Some(&varied) };
        let mocap = [3, 4].map(|width| recording.input(quantities.len() + width - 1, width * model.sizes.nmocap));
        let (mocap_pos, mocap_quat) = (mocap[0].as_chunks().0, mocap[1].as_chunks().0);
        let configuration = Configuration { qpos: &qpos, low: &[], mocap_pos, mocap_quat };
        position::kinematics(instance, configuration, &mut position);
        let mut tendons = Tendons::new(&model.sizes);
        if model.tendons.iter().any(|tendon| tendon.heavy) {
            // Their velocities count for nothing here.
            let qvel = recording.input(quantities.len() + 1, model.sizes.nv);
            tendon::tendons(model, &position, &qpos, &qvel, &mut tendons);
        }
        inertia::crb(instance, &position, &tendons, &mut inertia);
        let known = |lanes: &[Recorder<T>]| lanes.iter().map(|lane| lane.constant()).collect::<Vec<_>>();
        let axes = known(position.cdof.as_flattened());
        let entries = known(&inertia.m);
        let outputs = quantities.len() + 4;
        recording.output(outputs, position.cdof.as_flattened());
        recording.output(outputs + 1, &inertia.m);
        let uses = recording.finish().uses();
        let read: Vec<_> = quantities.into_iter().zip(1..).filter(|(_, field)| uses.contains(field)).collect();
        let reads = Quantities::of(&read.into_iter().map(|(quantity, _)| quantity).collect::<Vec<_>>());
        let still = |x: &Option<T>| x.is_some_and(|x| x.to_f64() == 0.0);
        let live = std::array::from_fn(|c| !axes.iter().skip(c).step_by(6).all(still));
        Structure { axes, inertia: entries, live, reads }
    }

    /// Replaces the lanes of a field that are known.
    pub fn fill_in(&self, name: Name, lanes: &mut [Recorder<T>]) {
        let known: &[Option<T>] = match name {
            ["position", "cdof"] => &self.axes,
            ["inertia", "m"] => &self.inertia,
            _ => &[],
        };
        for (lane, known) in lanes.iter_mut().zip(known) {
            if let Some(x) = known {
                *lane = Recorder::splat(*x);
            }
        }
        for (entry, lane) in lanes.iter_mut().enumerate() {
            if self.is_dead(name, entry) {
                *lane = Recorder::zero();
            }
        }
    }

    /// Whether an entry of a field is one of those that no motion has, which nobody reads who knows: they stay as they are.
    pub fn is_dead(&self, name: Name, entry: usize) -> bool {
        let live = self.live;
        match name {
            ["solver", "twist" | "cold_twist" | "wrench"] | ["velocity", "cvel"] | ["constraint", "motion"] => {
                !live[entry % 6]
            }
            ["solver", "stiffness"] => {
                let mut entries = (0..6).flat_map(|i| (0..=i).map(move |j| (i, j))).skip(entry % 21);
                entries.next().is_some_and(|(i, j)| !live[i] || !live[j])
            }
            _ => false,
        }
    }
}
