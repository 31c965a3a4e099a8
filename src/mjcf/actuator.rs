//! `actuator`: the general actuator and the shortcuts for common kinds.
//!
//! A class holds one actuator record, whatever tag wrote it. Mechanical attributes (ranges, gear, ...) inherit from that
//! record; the parameters of a shortcut (kp, kv, ...) only from a record that the same shortcut or `general` wrote.

use super::reader::Reader;
use super::report::quoted;
use super::tree::Element;
use crate::spec::{Actuator, Bias, Gain, Transmission, Tri, is_limited};
use crate::suggest::or_list;

/// The tag of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tag {
    General,
    Motor,
    Position,
    Velocity,
    Damper,
    /// A kind that is not supported.
    Other,
}

impl Tag {
    /// How many there are.
    pub const COUNT: usize = 6;

    /// The kind of a tag of the actuator section or of a default; `None` if it is not an actuator.
    pub fn of(tag: &str) -> Option<Tag> {
        Some(match tag {
            "general" => Tag::General,
            "motor" => Tag::Motor,
            "position" => Tag::Position,
            "velocity" => Tag::Velocity,
            "damper" => Tag::Damper,
            "intvelocity" | "cylinder" | "muscle" | "adhesion" | "dcmotor" | "pid" | "orientation" | "plugin" => {
                Tag::Other
            }
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
    /// Its name.
    Other(&'static str),
}

const GAINS: &[(&str, Law)] = &[
    ("fixed", Law::Fixed),
    ("affine", Law::Affine),
    ("muscle", Law::Other("muscle")),
    ("dcmotor", Law::Other("dcmotor")),
    ("user", Law::Other("user")),
];
const BIASES: &[(&str, Law)] = &[
    ("none", Law::Zero),
    ("affine", Law::Affine),
    ("muscle", Law::Other("muscle")),
    ("dcmotor", Law::Other("dcmotor")),
    ("user", Law::Other("user")),
];
const DYNAMICS: &[(&str, bool)] = &[
    ("none", false),
    ("integrator", true),
    ("filter", true),
    ("filterexact", true),
    ("muscle", true),
    ("dcmotor", true),
    ("user", true),
];

/// An actuator as written, or the record of a class.
#[derive(Clone, Debug)]
pub(super) struct RawActuator {
    /// Mechanical attributes; gain and bias are below.
    common: Actuator,
    gain: Law,
    bias: Law,
    gainprm: [f64; 10],
    /// Of a servo, `biasprm[2]` is minus the velocity gain, or the damping ratio if positive.
    biasprm: [f64; 10],
    /// The attribute that gives it an activation state.
    stateful: Option<&'static str>,
    timeconst: f64,
    inheritrange: f64,
    delay: f64,
    /// What it has that is not supported.
    newer: Option<String>,
    /// Whether it bounds its activation.
    actlimited: Tri,
    actrange: Option<[f64; 2]>,
    actdim: i32,
}

impl Default for RawActuator {
    fn default() -> Self {
        let mut gainprm = [0.0; 10];
        gainprm[0] = 1.0;
        RawActuator {
            common: Actuator::default(),
            gain: Law::Fixed,
            bias: Law::Zero,
            gainprm,
            biasprm: [0.0; 10],
            stateful: None,
            timeconst: 0.0,
            inheritrange: 0.0,
            delay: 0.0,
            newer: None,
            actlimited: Tri::Auto,
            actrange: None,
            actdim: -1,
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
            Tag::Damper => self.read_damper(donor, reader),
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
        reader.real("delay", &mut self.delay);
        reader.ignored("lengthrange", 2, false);
    }

    fn read_general(&mut self, reader: &mut Reader) {
        let mut stateful = self.stateful.is_some();
        reader.keyword("dyntype", DYNAMICS, &mut stateful);
        self.stateful = stateful.then(|| self.stateful.unwrap_or("dyntype"));
        reader.keyword("gaintype", GAINS, &mut self.gain);
        reader.keyword("biastype", BIASES, &mut self.bias);
        reader.leading("gainprm", &mut self.gainprm);
        reader.leading("biasprm", &mut self.biasprm);
        reader.ignored("dynprm", 10, true);
        reader.range("actrange", &mut self.actrange);
        reader.tri("actlimited", &mut self.actlimited);
        reader.boolean("actearly", &mut false);
        reader.integer("actdim", &mut self.actdim);
        self.read_inheritrange(reader);
        for name in ["ffrange", "velrange"].into_iter().filter(|name| reader.has_value(name)) {
            self.newer = Some(format!("attribute \"{name}\": an actuator with several inputs is"));
        }
        self.read_input(reader);
    }

    /// What the control is compared with says nothing about the force: the bias does. Only several inputs would matter.
    fn read_input(&mut self, reader: &mut Reader) {
        const INPUTS: [&str; 3] = ["pos", "vel", "pressure"];
        const OTHERS: [&str; 2] = ["ff", "none"];
        let Some(text) = reader.element.get("input") else { return };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        if let Some(word) = words.iter().find(|word| !INPUTS.contains(word) && !OTHERS.contains(word)) {
            let remedy = or_list(word, INPUTS);
            return reader.report.error(
                reader.element,
                format!("attribute \"input\": {} is unknown", quoted(word)),
                remedy,
            );
        }
        if words.len() > 1 || words.iter().any(|word| OTHERS.contains(word)) {
            self.newer = Some(format!("attribute \"input\": an actuator with the inputs {} is", quoted(text)));
        }
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
        let (mut kp, mut damping) = (donor.gainprm[0], donor.biasprm[2]);
        self.timeconst = donor.timeconst;
        self.inheritrange = donor.inheritrange;
        reader.real("kp", &mut kp);
        let (mut kv, mut ratio) = (0.0, 0.0);
        let (has_kv, has_ratio) = (reader.real("kv", &mut kv), reader.real("dampratio", &mut ratio));
        if has_kv && has_ratio {
            reader.report.error(reader.element, "both kv and dampratio are given", "keep one");
        }
        if ratio < 0.0 || kv < 0.0 {
            reader.report.error(reader.element, "kv and dampratio must not be negative", "");
        } else if has_kv {
            damping = -kv;
        } else if has_ratio {
            damping = ratio;
        }
        self.read_inheritrange(reader);
        reader.real("timeconst", &mut self.timeconst);
        let timeconst = self.timeconst;
        self.set(Law::Fixed, &[kp], Law::Affine, &[0.0, -kp, damping]);
        self.timeconst = timeconst;
        self.stateful = (timeconst > 0.0).then_some("timeconst");
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

    /// Sets the laws of a shortcut, which has no activation unless it says so.
    fn set(&mut self, gain: Law, gainprm: &[f64], bias: Law, biasprm: &[f64]) {
        (self.gain, self.bias) = (gain, bias);
        self.gainprm = [0.0; 10];
        self.gainprm[..gainprm.len()].copy_from_slice(gainprm);
        self.biasprm = [0.0; 10];
        self.biasprm[..biasprm.len()].copy_from_slice(biasprm);
        self.stateful = None;
        self.timeconst = 0.0;
        self.newer = None;
    }

    /// Why the actuator cannot be had.
    fn missing(&self, element: &Element) -> Option<String> {
        let transmission = ["tendon", "site", "cranksite", "body"].iter().find(|name| element.get(name).is_some());
        if let Some(name) = transmission {
            return Some(format!("transmission through a {name} is"));
        }
        let law = |attribute: &str, law| match law {
            Law::Other(name) => Some(format!("{attribute} \"{name}\" is")),
            _ => None,
        };
        let what = self
            .newer
            .clone()
            .or_else(|| self.stateful.map(|attribute| format!("attribute \"{attribute}\": an activation state is")))
            .or_else(|| law("gaintype", self.gain))
            .or_else(|| law("biastype", self.bias))
            .or_else(|| (self.delay != 0.0).then(|| "attribute \"delay\": a delay is".to_string()))
            .or_else(|| (self.actdim > 1).then(|| format!("attribute \"actdim\": {} activations are", self.actdim)))?;
        Some(what)
    }

    /// The actuator; `None` if it cannot be had, which is reported.
    pub fn finish(self, tag: Tag, reader: &mut Reader) -> Option<Actuator> {
        if let Some(what) = self.missing(reader.element) {
            reader.report.unsupported(reader.element, &what);
            return None;
        }
        let transmission = match (reader.element.get("joint"), reader.element.get("jointinparent")) {
            (Some(joint), None) => Transmission::Joint(joint.to_string()),
            (None, Some(joint)) => Transmission::JointInParent(joint.to_string()),
            (None, None) => {
                reader.report.error(reader.element, "nothing to act on", "give joint or jointinparent");
                return None;
            }
            (Some(_), Some(_)) => {
                reader.report.error(reader.element, "both joint and jointinparent are given", "keep one");
                return None;
            }
        };
        for name in ["refsite", "slidersite", "cranklength"] {
            if reader.has_value(name) {
                reader.report.error(reader.element, format!("attribute \"{name}\" does not go with a joint"), "");
            }
        }
        if is_limited(self.actrange, self.actlimited) {
            let message = "attribute \"actrange\" or \"actlimited\": the actuator has no activation";
            reader.report.error(reader.element, message, "remove it");
        }
        if tag == Tag::Damper && self.common.ctrlrange.is_none() {
            reader.report.error(reader.element, "a damper needs a ctrlrange", "");
        }
        Some(self.resolve(transmission, reader))
    }

    fn resolve(self, transmission: Transmission, reader: &Reader) -> Actuator {
        let first = |prm: [f64; 10]| [prm[0], prm[1], prm[2]];
        let (gain, bias) = (
            if self.gain == Law::Affine { Gain::Affine } else { Gain::Fixed },
            if self.bias == Law::Affine { Bias::Affine } else { Bias::None },
        );
        let mut actuator = Actuator {
            name: reader.text("name"),
            transmission,
            gain,
            gainprm: first(self.gainprm),
            bias,
            biasprm: first(self.biasprm),
            source: reader.element.source.clone(),
            ..self.common
        };
        // A damping ratio and an inherited range mean something for servos only, however they were written.
        let servo = bias == Bias::Affine && actuator.gainprm[0] == -actuator.biasprm[1];
        if servo && actuator.ctrlrange.is_none() {
            actuator.inheritrange = self.inheritrange;
        }
        if servo && gain == Gain::Fixed && actuator.biasprm[2] > 0.0 {
            actuator.dampratio = std::mem::take(&mut actuator.biasprm[2]);
        }
        actuator
    }
}
