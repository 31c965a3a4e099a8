//! `actuator`: the general actuator and the shortcuts for common kinds.
//!
//! A class holds one actuator record, whatever tag wrote it. Mechanical attributes (ranges, gear, ...) inherit from that
//! record; the parameters of a shortcut (kp, kv, ...) only from a record that the same shortcut or `general` wrote.

use super::history::history;
use super::reader::Reader;
use super::report::quoted;
use crate::spec::{Actuator, Bias, Dynamics, Gain, Input, Transmission, Tri, is_limited};
use crate::suggest::or_list;

/// The tag of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tag {
    General,
    Motor,
    Position,
    Velocity,
    IntVelocity,
    Damper,
    Cylinder,
    Muscle,
    Adhesion,
    Pid,
    DcMotor,
    Orientation,
    /// A kind that is not supported.
    Other,
}

impl Tag {
    /// How many there are.
    pub const COUNT: usize = 13;

    /// The kind of a tag of the actuator section or of a default; `None` if it is not an actuator.
    pub fn of(tag: &str) -> Option<Tag> {
        Some(match tag {
            "general" => Tag::General,
            "motor" => Tag::Motor,
            "position" => Tag::Position,
            "velocity" => Tag::Velocity,
            "intvelocity" => Tag::IntVelocity,
            "damper" => Tag::Damper,
            "cylinder" => Tag::Cylinder,
            "muscle" => Tag::Muscle,
            "adhesion" => Tag::Adhesion,
            "pid" => Tag::Pid,
            "dcmotor" => Tag::DcMotor,
            "orientation" => Tag::Orientation,
            "plugin" => Tag::Other,
            _ => return None,
        })
    }
}

/// A gain or bias: ours, or one that is not supported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Law {
    Zero,
    Fixed,
    Affine,
    Muscle,
    Pid,
    DcMotor,
    So3,
    /// Its name.
    Other(&'static str),
}

/// How an activation follows the control: ours, or one that is not supported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    Of(Dynamics),
    /// Its name.
    Other(&'static str),
}

const GAINS: &[(&str, Law)] = &[
    ("fixed", Law::Fixed),
    ("affine", Law::Affine),
    ("muscle", Law::Muscle),
    ("dcmotor", Law::DcMotor),
    ("pid", Law::Pid),
    ("so3", Law::So3),
    ("user", Law::Other("user")),
];
const BIASES: &[(&str, Law)] = &[
    ("none", Law::Zero),
    ("affine", Law::Affine),
    ("muscle", Law::Muscle),
    ("dcmotor", Law::DcMotor),
    ("so3", Law::So3),
    ("user", Law::Other("user")),
];
const DYNAMICS: &[(&str, Motion)] = &[
    ("none", Motion::Of(Dynamics::None)),
    ("integrator", Motion::Of(Dynamics::Integrator)),
    ("filter", Motion::Of(Dynamics::Filter)),
    ("filterexact", Motion::Of(Dynamics::FilterExact)),
    ("muscle", Motion::Of(Dynamics::Muscle)),
    ("dcmotor", Motion::Of(Dynamics::DcMotor)),
    ("pid", Motion::Of(Dynamics::Pid)),
    ("user", Motion::Other("user")),
];
/// Gain of a muscle: MuJoCo's defaults.
const MUSCLE: [f64; 9] = [0.75, 1.05, -1.0, 200.0, 0.5, 1.6, 1.5, 1.3, 1.2];
/// Its attributes beside its range, in the order of the gain's parameters.
const MUSCLE_PARAMETERS: [&str; 7] = ["force", "scale", "lmin", "lmax", "vmax", "fpmax", "fvmax"];

/// An actuator as written, or the record of a class.
#[derive(Clone, Debug)]
pub(super) struct RawActuator {
    /// Mechanical attributes; gain, bias and dynamics are below.
    common: Actuator,
    gain: Law,
    bias: Law,
    gainprm: [f64; 10],
    /// Of a servo, `biasprm[2]` is minus the velocity gain, or the damping ratio if positive.
    biasprm: [f64; 10],
    dynamics: Motion,
    dynprm: [f64; 10],
    inheritrange: f64,
    /// Length of a crank's rod.
    cranklength: f64,
    /// What it has that is not supported.
    newer: Option<String>,
    /// What it says its controls are, if anything.
    named: Option<String>,
    actdim: i32,
}

impl Default for RawActuator {
    fn default() -> Self {
        let common = Actuator::default();
        RawActuator {
            gain: Law::Fixed,
            bias: Law::Zero,
            gainprm: common.gainprm,
            biasprm: common.biasprm,
            dynamics: Motion::Of(Dynamics::None),
            dynprm: common.dynprm,
            inheritrange: 0.0,
            cranklength: 0.0,
            newer: None,
            named: None,
            actdim: -1,
            common,
        }
    }
}

impl RawActuator {
    /// Reads the attributes of a tag. `donor` is the record from which the shortcut's own parameters inherit, if any.
    pub fn read(&mut self, tag: Tag, donor: Option<&RawActuator>, reader: &mut Reader) {
        self.read_common(reader);
        match tag {
            Tag::General => self.read_general(reader),
            Tag::Motor => self.set(Law::Fixed, &[1.0], Law::Zero, &[]),
            Tag::Position => self.read_position(donor, reader),
            Tag::Velocity => self.read_velocity(donor, reader),
            Tag::IntVelocity => self.read_intvelocity(donor, reader),
            Tag::Damper => self.read_damper(donor, reader),
            Tag::Cylinder => self.read_cylinder(donor, reader),
            Tag::Muscle => self.read_muscle(donor, reader),
            Tag::Adhesion => self.read_adhesion(donor, reader),
            Tag::Pid => self.read_pid(donor, reader),
            Tag::DcMotor => self.read_dcmotor(donor, reader),
            Tag::Orientation => self.read_orientation(donor, reader),
            Tag::Other => self.newer = Some(format!("actuators of kind {} are", reader.element.tag)),
        }
    }

    fn read_common(&mut self, reader: &mut Reader) {
        let a = &mut self.common;
        let (range, inherit) = (reader.has_value("ctrlrange"), reader.has_value("inheritrange"));
        if range && inherit {
            reader.report.error(reader.element, "both ctrlrange and inheritrange are given", "keep one");
        } else if inherit {
            a.ctrlrange = None;
        }
        reader.range("ctrlrange", &mut a.ctrlrange);
        reader.tri("ctrllimited", &mut a.ctrllimited);
        reader.range("forcerange", &mut a.forcerange);
        reader.tri("forcelimited", &mut a.forcelimited);
        reader.leading("gear", &mut a.gear);
        reader.leading("damping", &mut a.damping);
        reader.real("armature", &mut a.armature);
        reader.integer("group", &mut a.group);
        history(reader, &mut a.history);
        reader.real("cranklength", &mut self.cranklength);
        reader.range("lengthrange", &mut a.lengthrange);
    }

    fn read_general(&mut self, reader: &mut Reader) {
        reader.keyword("dyntype", DYNAMICS, &mut self.dynamics);
        reader.keyword("gaintype", GAINS, &mut self.gain);
        reader.keyword("biastype", BIASES, &mut self.bias);
        reader.leading("gainprm", &mut self.gainprm);
        reader.leading("biasprm", &mut self.biasprm);
        reader.leading("dynprm", &mut self.dynprm);
        self.read_actrange(reader);
        reader.boolean("actearly", &mut self.common.actearly);
        reader.integer("actdim", &mut self.actdim);
        self.read_inheritrange(reader);
        reader.range("velrange", &mut self.common.velrange);
        reader.range("ffrange", &mut self.common.ffrange);
        self.read_input(reader);
    }

    /// What the controls are. Of an actuator with one it says nothing about the force: the bias does.
    fn read_input(&mut self, reader: &mut Reader) {
        const WORDS: [&str; 8] = ["pos", "vel", "ff", "voltage", "pressure", "expmap", "quat", "none"];
        let Some(text) = reader.element.get("input").filter(|text| !text.trim().is_empty()) else { return };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let places: Vec<Option<usize>> =
            words.iter().map(|word| WORDS.iter().position(|known| known == word)).collect();
        if let Some(unknown) = places.iter().position(Option::is_none) {
            let remedy = or_list(words[unknown], WORDS);
            let message = format!("attribute \"input\": {} is unknown", quoted(words[unknown]));
            return reader.report.error(reader.element, message, remedy);
        }
        if !places.is_sorted_by(|a, b| a < b) || words.len() > 1 && words.contains(&"none") {
            let message = format!("attribute \"input\": {} are not once each and in order", quoted(text));
            return reader.report.error(
                reader.element,
                message,
                "give any of pos, vel, ff, voltage, in this order, or none",
            );
        }
        let known = |word: &&str| Input::ALL.iter().find(|(known, _)| known == word).map(|(_, input)| *input);
        self.common.inputs = words.iter().filter_map(known).collect();
        self.named = Some(text.to_string());
    }

    /// Takes over what a class says the controls are.
    fn adopt_input(&mut self, donor: Option<&RawActuator>) {
        self.named = donor.and_then(|donor| donor.named.clone());
        self.common.inputs = donor.map_or(Vec::new(), |donor| donor.common.inputs.clone());
    }

    /// What a controller's gains follow: those of a class that the same shortcut or `general` wrote.
    fn read_pid(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        self.adopt_input(donor);
        let (mut prm, mut windup, mut slew) = ([1.0, 0.0, 0.0], 0.0, 0.0);
        if let Some(donor) = donor {
            prm = [-donor.biasprm[1], donor.biasprm[2], donor.gainprm[0]];
            [windup, slew] = [donor.dynprm[0], donor.dynprm[1]];
            self.inheritrange = donor.inheritrange;
        }
        let [mut kp, mut damping, mut ki] = prm;
        reader.real("kp", &mut kp);
        read_damping(&mut damping, reader);
        reader.real("ki", &mut ki);
        reader.real("imax", &mut windup);
        reader.real("slewmax", &mut slew);
        for (name, x) in [("ki", ki), ("imax", windup), ("slewmax", slew)] {
            if x < 0.0 {
                reader.report.error(reader.element, format!("{name} must not be negative"), "give 0 for none");
            }
        }
        reader.range("posrange", &mut self.common.ctrlrange);
        reader.range("velrange", &mut self.common.velrange);
        reader.range("ffrange", &mut self.common.ffrange);
        self.read_inheritrange(reader);
        self.read_input(reader);
        self.set(Law::Pid, &[ki], Law::Affine, &[0.0, -kp, damping]);
        if ki != 0.0 || slew > 0.0 {
            self.dynamics = Motion::Of(Dynamics::Pid);
        }
        self.dynprm = [0.0; 10];
        [self.dynprm[0], self.dynprm[1]] = [windup, slew];
    }

    fn read_orientation(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        self.adopt_input(donor);
        let (mut kp, mut damping) = donor.map_or((1.0, 0.0), |donor| (donor.gainprm[0], donor.biasprm[2]));
        reader.real("kp", &mut kp);
        read_damping(&mut damping, reader);
        self.read_input(reader);
        self.set(Law::So3, &[kp], Law::So3, &[0.0, -kp, damping]);
    }

    /// A motor's numbers: those of a class that the same shortcut or `general` wrote, and what is given. As in MuJoCo, the nominal point tells
    /// what neither the constants nor the resistance do.
    fn read_dcmotor(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        self.adopt_input(donor);
        let (mut gain, mut bias, mut dynamics) =
            donor.map_or(([0.0; 10], [0.0; 10], [0.0; 10]), |donor| (donor.gainprm, donor.biasprm, donor.dynprm));
        self.read_input(reader);
        motor_constants(&mut gain, reader);
        let [resistance, constant] = [gain[0], gain[1]];
        let mut inductance = [0.0; 2];
        if leading(reader, "inductance", &mut inductance) {
            dynamics[0] = if inductance[0] > 0.0 { inductance[0] / resistance } else { inductance[1] };
        }
        let mut limits = [0.0; 3];
        if leading(reader, "saturation", &mut limits) {
            let torque = if limits[0] > 0.0 { limits[0] } else { constant * limits[1] };
            self.common.forcerange = (torque > 0.0).then_some([-torque, torque]);
            dynamics[1] = limits[2];
        }
        let mut thermal = [0.0; 6];
        if leading(reader, "thermal", &mut thermal) {
            motor_warmth(thermal, &mut gain, &mut dynamics, reader);
        }
        reader.leading("cogging", &mut bias[..3]);
        let mut friction = [0.0; 5];
        if leading(reader, "lugre", &mut friction) {
            dynamics[5..7].copy_from_slice(&friction[..2]);
            bias[3..6].copy_from_slice(&friction[2..]);
        }
        let mut controller = [gain[4], gain[5], gain[6], dynamics[7], dynamics[8], gain[7]];
        reader.leading("controller", &mut controller);
        [gain[4], gain[5], gain[6], dynamics[7], dynamics[8], gain[7]] = controller;
        self.set(Law::DcMotor, &gain, Law::DcMotor, &bias);
        (self.dynamics, self.dynprm) = (Motion::Of(Dynamics::DcMotor), dynamics);
    }

    fn read_actrange(&mut self, reader: &mut Reader) {
        reader.range("actrange", &mut self.common.actrange);
        reader.tri("actlimited", &mut self.common.actlimited);
    }

    /// A control range at a place overrides an inherited `inheritrange`.
    fn read_inheritrange(&mut self, reader: &mut Reader) {
        if reader.has_value("ctrlrange") {
            self.inheritrange = 0.0;
        }
        reader.real("inheritrange", &mut self.inheritrange);
    }

    fn read_position(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        let neutral = RawActuator::default();
        let donor = donor.unwrap_or(&neutral);
        let (dynamics, mut time) = (donor.dynamics, donor.dynprm[0]);
        self.read_servo(donor, reader);
        (self.dynamics, self.dynprm) = (dynamics, donor.dynprm);
        if reader.real("timeconst", &mut time) {
            if time < 0.0 {
                reader.report.error(reader.element, "timeconst must not be negative", "");
            }
            self.dynamics = Motion::Of(if time > 0.0 { Dynamics::FilterExact } else { Dynamics::None });
            self.dynprm[0] = time;
        }
    }

    fn read_intvelocity(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        if reader.has_value("actrange") && reader.has_value("inheritrange") {
            reader.report.error(reader.element, "both actrange and inheritrange are given", "keep one");
        }
        let neutral = RawActuator::default();
        self.read_servo(donor.unwrap_or(&neutral), reader);
        self.dynamics = Motion::Of(Dynamics::Integrator);
        self.read_actrange(reader);
        if reader.has_value("actrange") {
            self.inheritrange = 0.0;
        }
    }

    /// Gain and bias of a servo on the position.
    fn read_servo(&mut self, donor: &RawActuator, reader: &mut Reader) {
        let (mut kp, mut damping) = (donor.gainprm[0], donor.biasprm[2]);
        self.inheritrange = donor.inheritrange;
        reader.real("kp", &mut kp);
        read_damping(&mut damping, reader);
        self.read_inheritrange(reader);
        self.set(Law::Fixed, &[kp], Law::Affine, &[0.0, -kp, damping]);
    }

    fn read_velocity(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        let mut kv = donor.map_or(1.0, |donor| donor.gainprm[0]);
        reader.real("kv", &mut kv);
        self.set(Law::Fixed, &[kv], Law::Affine, &[0.0, 0.0, -kv]);
    }

    fn read_damper(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        let mut kv = donor.map_or(0.0, |donor| -donor.gainprm[2]);
        reader.real("kv", &mut kv);
        if kv < 0.0 {
            reader.report.error(reader.element, "the damping coefficient kv must not be negative", "");
        }
        if self.common.ctrlrange.is_some_and(|range| range[0] < 0.0) {
            reader.report.error(reader.element, "the ctrlrange of a damper must not be negative", "");
        }
        self.common.ctrllimited = Tri::True;
        self.set(Law::Affine, &[0.0, 0.0, -kv], Law::Zero, &[]);
    }

    fn read_cylinder(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        let neutral = RawActuator::default();
        let donor = donor.unwrap_or(&neutral);
        let (mut area, mut bias, mut dynprm) = (donor.gainprm[0], donor.biasprm, donor.dynprm);
        let mut diameter = -1.0;
        reader.real("timeconst", &mut dynprm[0]);
        reader.real("area", &mut area);
        reader.list("bias", &mut bias[..3]);
        reader.real("diameter", &mut diameter);
        if diameter >= 0.0 {
            area = std::f64::consts::PI / 4.0 * diameter * diameter;
        }
        self.set(Law::Fixed, &[area], Law::Affine, &bias);
        (self.dynamics, self.dynprm) = (Motion::Of(Dynamics::Filter), dynprm);
    }

    /// A gain alone: the control is a share of the force.
    fn read_adhesion(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        let mut gain = donor.map_or(1.0, |donor| donor.gainprm[0]);
        reader.real("gain", &mut gain);
        if gain < 0.0 {
            reader.report.error(reader.element, "the gain of adhesion must not be negative", "");
        }
        if self.common.ctrlrange.is_some_and(|range| range[0] < 0.0) {
            reader.report.error(reader.element, "the ctrlrange of adhesion must not be negative", "");
        }
        self.common.ctrllimited = Tri::True;
        self.set(Law::Fixed, &[gain], Law::Zero, &[]);
    }

    /// What a class leaves at the defaults of other actuators has those of muscles.
    fn read_muscle(&mut self, donor: Option<&RawActuator>, reader: &mut Reader) {
        let neutral = RawActuator::default();
        let donor = donor.unwrap_or(&neutral);
        let (mut gain, mut dynprm) = (donor.gainprm, donor.dynprm);
        let fill = |target: &mut [f64], neutral: &[f64], own: &[f64]| {
            let unset = target.iter_mut().zip(neutral).zip(own).filter(|((x, neutral), _)| x == neutral);
            unset.for_each(|((x, _), own)| *x = *own);
        };
        fill(&mut gain, &neutral.gainprm, &MUSCLE);
        fill(&mut dynprm, &neutral.dynprm, &[0.01, 0.04]);
        // MuJoCo takes only what is not negative.
        let pair = |reader: &mut Reader, name: &str, target: &mut [f64]| {
            let mut given = [-1.0; 2];
            reader.list(name, &mut given);
            target.iter_mut().zip(given).filter(|(_, x)| *x >= 0.0).for_each(|(target, x)| *target = x);
        };
        pair(reader, "timeconst", &mut dynprm[..2]);
        pair(reader, "range", &mut gain[..2]);
        let mut smooth = dynprm[2];
        if reader.real("tausmooth", &mut smooth) && smooth < 0.0 {
            reader.report.error(reader.element, "tausmooth must not be negative", "");
        }
        dynprm[2] = smooth;
        for (name, target) in MUSCLE_PARAMETERS.into_iter().zip(&mut gain[2..]) {
            let mut given = -1.0;
            reader.real(name, &mut given);
            if given >= 0.0 {
                *target = given;
            }
        }
        self.set(Law::Muscle, &gain, Law::Muscle, &gain);
        (self.dynamics, self.dynprm) = (Motion::Of(Dynamics::Muscle), dynprm);
    }

    /// Sets the laws of a shortcut, which has no activation unless it says so.
    fn set(&mut self, gain: Law, gainprm: &[f64], bias: Law, biasprm: &[f64]) {
        (self.gain, self.bias) = (gain, bias);
        if gain != Law::Pid {
            (self.common.velrange, self.common.ffrange) = (None, None);
        }
        if !matches!(gain, Law::Pid | Law::DcMotor | Law::So3) {
            self.adopt_input(None);
        }
        self.gainprm = [0.0; 10];
        self.gainprm[..gainprm.len()].copy_from_slice(gainprm);
        self.biasprm = [0.0; 10];
        self.biasprm[..biasprm.len()].copy_from_slice(biasprm);
        (self.dynamics, self.dynprm) = (Motion::Of(Dynamics::None), Actuator::default().dynprm);
        self.newer = None;
    }

    /// Why the actuator cannot be had.
    fn missing(&self) -> Option<String> {
        let law = |attribute: &str, law| match law {
            Law::Other(name) => Some(format!("{attribute} \"{name}\" is")),
            _ => None,
        };
        let what = self
            .newer
            .clone()
            .or_else(|| match self.dynamics {
                Motion::Other(name) => Some(format!("dyntype \"{name}\" is")),
                Motion::Of(_) => None,
            })
            .or_else(|| law("gaintype", self.gain))
            .or_else(|| law("biastype", self.bias))?;
        Some(what)
    }

    /// The actuator; `None` if it cannot be had, which is reported.
    pub fn finish(self, tag: Tag, reader: &mut Reader) -> Option<Actuator> {
        if let Some(what) = self.missing() {
            reader.report.unsupported(reader.element, &what);
            return None;
        }
        let transmission = self.transmission(reader)?;
        let stateful = self.dynamics != Motion::Of(Dynamics::None);
        if !stateful && is_limited(self.common.actrange, self.common.actlimited) {
            let message = "attribute \"actrange\" or \"actlimited\": the actuator has no activation";
            reader.report.error(reader.element, message, "remove it");
        }
        if matches!(tag, Tag::Damper | Tag::Adhesion) && self.common.ctrlrange.is_none() {
            let what = if tag == Tag::Damper { "a damper" } else { "adhesion" };
            reader.report.error(reader.element, format!("{what} needs a ctrlrange"), "");
        }
        if let Some(text) = self.named.as_ref().filter(|_| !matches!(self.gain, Law::Pid | Law::DcMotor)) {
            let known: &[&str] = if self.gain == Law::So3 { &["expmap", "quat"] } else { &["pos", "vel", "pressure"] };
            if !known.contains(&text.trim()) {
                let message = format!("attribute \"input\": {} is none that the actuator has", quoted(text));
                reader.report.error(reader.element, message, or_list(text.trim(), known.iter().copied()));
            }
        }
        let (dim, actuator) = (self.actdim, self.resolve(transmission, reader));
        let has = actuator.activations();
        if dim >= 0 && usize::try_from(dim) != Ok(has) {
            let has =
                ["no activation", "one activation"].get(has).map_or(format!("{has} activations"), |has| (*has).into());
            let message = format!("attribute \"actdim\": {dim}, but the actuator has {has}");
            reader.report.error(reader.element, message, "remove it");
        }
        Some(actuator)
    }

    /// What it acts on; `None` if that cannot be told, which is reported.
    fn transmission(&self, reader: &mut Reader) -> Option<Transmission> {
        const TARGETS: [&str; 6] = ["joint", "jointinparent", "tendon", "site", "cranksite", "body"];
        let element = reader.element;
        let given: Vec<&str> = TARGETS.into_iter().filter(|name| element.get(name).is_some()).collect();
        let target = match given[..] {
            [target] => target,
            [] => {
                let remedy = "give joint, jointinparent, tendon, site, cranksite or body";
                reader.report.error(element, "nothing to act on", remedy);
                return None;
            }
            [first, second, ..] => {
                reader.report.error(element, format!("both {first} and {second} are given"), "keep one");
                return None;
            }
        };
        for (name, with) in [("refsite", "site"), ("slidersite", "cranksite"), ("cranklength", "cranksite")] {
            if reader.has_value(name) && target != with {
                let message = format!("attribute \"{name}\" does not go with {target}");
                reader.report.error(element, message, format!("remove it, or give {with}"));
            }
        }
        let name = || element.get(target).unwrap_or_default().to_string();
        Some(match target {
            "joint" => Transmission::Joint(name()),
            "jointinparent" => Transmission::JointInParent(name()),
            "tendon" => Transmission::Tendon(name()),
            "body" => Transmission::Body(name()),
            "site" => Transmission::Site { site: name(), reference: element.get("refsite").map(str::to_string) },
            _ => {
                let Some(slider) = element.get("slidersite").map(str::to_string) else {
                    let message = "a crank without a slide";
                    reader.report.error(element, message, "give slidersite, along whose z axis the rod's end moves");
                    return None;
                };
                Transmission::SliderCrank { crank: name(), slider, rod: self.cranklength }
            }
        })
    }

    fn resolve(self, transmission: Transmission, reader: &Reader) -> Actuator {
        let gain = match self.gain {
            Law::Affine => Gain::Affine,
            Law::Muscle => Gain::Muscle,
            Law::Pid => Gain::Pid,
            Law::DcMotor => Gain::DcMotor,
            Law::So3 => Gain::So3,
            _ => Gain::Fixed,
        };
        let bias = match self.bias {
            Law::Affine => Bias::Affine,
            Law::Muscle => Bias::Muscle,
            Law::DcMotor => Bias::DcMotor,
            Law::So3 => Bias::So3,
            _ => Bias::None,
        };
        let dynamics = match self.dynamics {
            Motion::Of(dynamics) => dynamics,
            // Reported as missing.
            Motion::Other(_) => Dynamics::None,
        };
        let mut actuator = Actuator {
            name: reader.text("name"),
            transmission,
            gain,
            gainprm: self.gainprm,
            bias,
            biasprm: self.biasprm,
            dynamics,
            dynprm: self.dynprm,
            source: reader.element.source.clone(),
            ..self.common
        };
        actuator.quaternion = self.named.as_ref().is_some_and(|text| text.trim() == "quat");
        if self.named.is_none() && actuator.inputs.is_empty() {
            match gain {
                Gain::Pid => actuator.inputs = vec![Input::Pos, Input::Vel],
                Gain::DcMotor => actuator.inputs = vec![Input::Voltage],
                _ => {}
            }
        }
        // A damping ratio and an inherited range mean something for servos only, however they were written.
        let opposed = gain == Gain::Pid || actuator.gainprm[0] == -actuator.biasprm[1];
        let servo = matches!(bias, Bias::Affine | Bias::So3) && opposed;
        let ranged = if dynamics == Dynamics::Integrator { actuator.actrange } else { actuator.ctrlrange };
        if servo && ranged.is_none() {
            actuator.inheritrange = self.inheritrange;
        }
        if servo && matches!(gain, Gain::Fixed | Gain::Pid | Gain::So3) && actuator.biasprm[2] > 0.0 {
            actuator.dampratio = std::mem::take(&mut actuator.biasprm[2]);
        }
        actuator
    }
}

/// Reads `kv` or `dampratio` into the second number of a servo's bias.
fn read_damping(damping: &mut f64, reader: &mut Reader) {
    let (mut kv, mut ratio) = (0.0, 0.0);
    let (has_kv, has_ratio) = (reader.real("kv", &mut kv), reader.real("dampratio", &mut ratio));
    if has_kv && has_ratio {
        reader.report.error(reader.element, "both kv and dampratio are given", "keep one");
    }
    if ratio < 0.0 || kv < 0.0 {
        reader.report.error(reader.element, "kv and dampratio must not be negative", "");
    } else if has_kv {
        *damping = -kv;
    } else if has_ratio {
        *damping = ratio;
    }
}

/// Reads numbers, of which the last may be missing; says whether any were given.
fn leading(reader: &mut Reader, name: &str, target: &mut [f64]) -> bool {
    reader.leading(name, target);
    reader.has_value(name)
}

/// Reads a motor's resistance and constant.
fn motor_constants(gain: &mut [f64; 10], reader: &mut Reader) {
    let (mut constants, mut nominal) = ([0.0; 2], [0.0; 3]);
    let given = leading(reader, "motorconst", &mut constants);
    let pointed = leading(reader, "nominal", &mut nominal);
    let [voltage, stall, free] = nominal;
    if !given && !pointed {
        constants[0] = gain[1];
    }
    if constants[1] == 0.0 && voltage > 0.0 && free > 0.0 {
        constants[1] = voltage / free;
    }
    let [torque, back] = constants;
    gain[1] = if torque > 0.0 && back > 0.0 { (torque * back).sqrt() } else { torque.max(back) };
    if !reader.real("resistance", &mut gain[0]) && pointed && stall > 0.0 {
        gain[0] = gain[1] * voltage / stall;
    }
    if torque < 0.0 || back < 0.0 || nominal.iter().any(|x| *x < 0.0) {
        reader.report.error(reader.element, "motorconst and nominal must not be negative", "");
    }
}

/// What a motor's `thermal` says: of resistance, capacity and time constant any two.
fn motor_warmth(thermal: [f64; 6], gain: &mut [f64; 10], dynamics: &mut [f64; 10], reader: &mut Reader) {
    let [mut loss, mut capacity, time, warming, told_at, air] = thermal;
    if loss > 0.0 && time > 0.0 {
        capacity = time / loss;
    } else if loss == 0.0 && capacity > 0.0 {
        loss = time / capacity;
    }
    if loss < 0.0 || capacity < 0.0 || (loss > 0.0) != (capacity > 0.0) {
        let message = "attribute \"thermal\": of resistance, capacitance and time constant, two must be positive";
        reader.report.error(reader.element, message, "give any two of the first three numbers, or 0 for none");
    }
    dynamics[2..5].copy_from_slice(&[loss, capacity, air]);
    gain[2..4].copy_from_slice(&[warming, told_at]);
}
