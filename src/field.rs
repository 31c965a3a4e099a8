//! Fields: parts of a world's state, and forces from outside. Name, length and meaning are those of the kernels' declarations; everything
//! else that knows fields asks here.

use lanesim_kernels::fields::Declared;
use lanesim_kernels::model::Sizes;
use lanesim_kernels::state::{Applied, State};

use crate::model::{Key, Model};

/// A part of a world's state, or a force from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Field {
    /// Time, s: 1 number. It and positions have twice the digits of the other fields in single precision.
    Time,
    /// Positions: `nq`.
    Qpos,
    /// Velocities: `nv`.
    Qvel,
    /// Activations: `na`.
    Act,
    /// Histories of actuators and sensors: `nhistory`. Their times have twice the digits in single precision, too.
    History,
    /// Where springs rest that yield: `nplastic`.
    Plastic,
    /// Controls: `nu`.
    Ctrl,
    /// Start of the solver, what constraints added to the smooth acceleration in the last step: `nv`.
    QaccWarmstart,
    /// Whether each equality constraint is active: `neq`, 1 or 0.
    EqActive,
    /// Positions of mocap bodies: `nmocap` × 3.
    MocapPos,
    /// Orientations of mocap bodies, quaternions (w, x, y, z): `nmocap` × 4.
    MocapQuat,
    /// For how long each tree has rested: `nsleep`, which is 0 without the flag `sleep`.
    TreeRest,
    /// What the guard has booked of each tree: `nguard` × 15, none without the option `guard`.
    TreeGuard,
    /// Generalised forces from outside: `nv`.
    QfrcApplied,
    /// Forces and torques on bodies from outside: `nbody` × (force, torque), world axes, at the centre of mass.
    XfrcApplied,
}

/// Where a field of a block is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Home {
    /// Field of this number of the state.
    State(usize),
    /// Field of this number of the forces from outside.
    Applied(usize),
}

/// Number of fields of the state, but for the last one, low words, which are told and set as a part of time and positions.
const STATES: usize = State::<f64>::FIELDS.len() - 1;
/// Number of all fields.
const COUNT: usize = STATES + Applied::<f64>::FIELDS.len();

impl Field {
    /// All fields, in the order of the kernels' declarations.
    const ORDER: [Field; COUNT] = [
        Field::Time,
        Field::Qpos,
        Field::Qvel,
        Field::Act,
        Field::History,
        Field::Plastic,
        Field::Ctrl,
        Field::QaccWarmstart,
        Field::EqActive,
        Field::MocapPos,
        Field::MocapQuat,
        Field::TreeRest,
        Field::TreeGuard,
        Field::QfrcApplied,
        Field::XfrcApplied,
    ];

    /// All fields, with MuJoCo's names.
    pub const ALL: [(Field, &'static str); COUNT] = {
        let mut all = [(Field::Time, ""); COUNT];
        let mut i = 0;
        while i < COUNT {
            all[i] = (Self::ORDER[i], Self::ORDER[i].declared().name);
            i += 1;
        }
        all
    };

    /// What makes up a row of the output `state`, in its order: MuJoCo's `mjSTATE_FULLPHYSICS`.
    pub const STATE: [Field; 6] = [Field::Time, Field::Qpos, Field::Qvel, Field::Act, Field::History, Field::Plastic];

    /// The field of a name.
    pub fn named(name: &str) -> Option<Field> {
        Self::ALL.into_iter().find(|(_, known)| *known == name).map(|(field, _)| field)
    }

    /// Where it is kept.
    pub(crate) const fn home(self) -> Home {
        let number = self as usize;
        if number < STATES { Home::State(number) } else { Home::Applied(number - STATES) }
    }

    /// What the kernels declare.
    const fn declared(self) -> &'static Declared {
        match self.home() {
            Home::State(number) => &State::<f64>::FIELDS[number],
            Home::Applied(number) => &Applied::<f64>::FIELDS[number],
        }
    }

    /// MuJoCo's name.
    pub const fn name(self) -> &'static str {
        self.declared().name
    }

    /// What it is, with its unit.
    pub fn meaning(self) -> &'static str {
        self.declared().what
    }

    /// The names of a world's dimensions; numbers where they are the same for every model.
    pub fn dims(self) -> Vec<String> {
        let declared = self.declared();
        let own = declared.count.strip_prefix("sizes.").map(str::to_owned);
        own.into_iter().chain((declared.width > 1).then(|| declared.width.to_string())).collect()
    }

    /// A world's dimensions: the name of each count, empty where it is the same for every model, and the count.
    pub fn shape(self, model: &Model) -> Vec<(&'static str, usize)> {
        let declared = self.declared();
        let entries = (declared.entries)(&model.tables().sizes);
        let own = declared.count.strip_prefix("sizes.").map(|name| (name, entries));
        own.into_iter().chain((declared.width > 1).then_some(("", declared.width))).collect()
    }

    /// Of a field that has low words in single precision, the first of them in [`State::low`].
    pub(crate) const fn low(self, sizes: &Sizes) -> Option<usize> {
        match self {
            Field::Time => Some(0),
            Field::Qpos => Some(1),
            Field::History => Some(1 + sizes.nq),
            _ => None,
        }
    }

    /// Numbers per world.
    pub fn len(self, model: &Model) -> usize {
        self.lanes(&model.tables().sizes)
    }

    /// The same, from a model's sizes.
    pub(crate) fn lanes(self, sizes: &Sizes) -> usize {
        self.declared().len(sizes)
    }
}

impl Key {
    /// What a world that starts from it has in a field; `None`: zeros.
    pub fn field(&self, field: Field) -> Option<&[f64]> {
        match field {
            Field::Time => Some(std::slice::from_ref(&self.time)),
            Field::Qpos => Some(&self.qpos),
            Field::Qvel => Some(&self.qvel),
            Field::Act => Some(&self.act),
            Field::History => Some(&self.history),
            Field::Plastic => Some(&self.plastic),
            Field::Ctrl => Some(&self.ctrl),
            Field::EqActive => Some(&self.eq_active),
            Field::MocapPos => Some(&self.mpos),
            Field::MocapQuat => Some(&self.mquat),
            Field::TreeRest => Some(&self.tree_rest),
            Field::TreeGuard | Field::QaccWarmstart | Field::QfrcApplied | Field::XfrcApplied => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_what_kernels_declare() {
        let declared = State::<f64>::FIELDS[..STATES].iter().chain(Applied::<f64>::FIELDS);
        for (i, (declared, (field, name))) in declared.zip(Field::ALL).enumerate() {
            assert_eq!((i, declared.name), (field as usize, name));
            let letters = |text: &str| text.to_lowercase().replace('_', "");
            assert_eq!(letters(&format!("{field:?}")), letters(name));
            assert!(!field.meaning().is_empty());
        }
        let xml = "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>";
        let model = Model::from_xml_string(xml, &Default::default()).expect("a model");
        assert_eq!(Field::Time.shape(&model), []);
        assert_eq!(Field::Qpos.shape(&model), [("nq", 7)]);
        assert_eq!(Field::XfrcApplied.shape(&model), [("nbody", 2), ("", 6)]);
        assert_eq!(Field::XfrcApplied.len(&model), 12);
        assert_eq!(Field::XfrcApplied.dims(), ["nbody", "6"]);
    }
}
