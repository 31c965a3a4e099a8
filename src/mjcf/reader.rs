//! Attributes of one element, checked as they are read.

use super::orientation::Orientation;
use super::report::{Report, quoted};
use super::tree::Element;
use super::value::{self, BOOLEAN, TRI};
use crate::spec::Tri;

/// Reads attributes into fields that already hold their defaults: what is absent or blank leaves them alone.
pub(super) struct Reader<'a> {
    pub element: &'a Element,
    pub report: &'a mut Report,
}

impl<'a> Reader<'a> {
    pub fn new(element: &'a Element, report: &'a mut Report) -> Self {
        Reader { element, report }
    }

    /// Reports a bad attribute.
    fn bad(&mut self, name: &str, message: &str) {
        self.report.error(self.element, format!("attribute {}: {message}", quoted(name)), "");
    }

    /// Passes an attribute through a parser; `None` if it is absent or bad, which is reported.
    fn parsed<T>(&mut self, name: &str, parse: impl FnOnce(&str) -> Result<T, String>) -> Option<T> {
        let text = self.element.get(name)?;
        match parse(text) {
            Ok(value) => Some(value),
            Err(message) => {
                self.bad(name, &message);
                None
            }
        }
    }

    /// Whether an attribute is written at all.
    pub fn has(&self, name: &str) -> bool {
        self.element.get(name).is_some()
    }

    /// Whether an attribute is written and not blank.
    pub fn has_value(&self, name: &str) -> bool {
        self.element.get(name).is_some_and(|text| !text.trim().is_empty())
    }

    /// The text of an attribute, or nothing.
    pub fn text(&self, name: &str) -> String {
        self.element.get(name).unwrap_or_default().to_string()
    }

    /// A number; says whether one was given.
    pub fn real(&mut self, name: &str, target: &mut f64) -> bool {
        self.list(name, std::slice::from_mut(target))
    }

    /// As many numbers as `target` holds; says whether they were given.
    pub fn list(&mut self, name: &str, target: &mut [f64]) -> bool {
        self.parsed(name, |text| value::exactly(text, target)).unwrap_or(false)
    }

    /// At most as many numbers as `target` holds, replacing its first ones; says whether any was given.
    pub fn leading(&mut self, name: &str, target: &mut [f64]) -> bool {
        self.parsed(name, |text| value::leading(text, target)).unwrap_or(false)
    }

    /// Any number of numbers; `None` if there are none.
    pub fn all(&mut self, name: &str) -> Option<Vec<f64>> {
        self.parsed(name, value::numbers).filter(|list| !list.is_empty())
    }

    /// A range, whose ends may be infinite. MuJoCo's way to say that there is none is `0 0`.
    pub fn range(&mut self, name: &str, target: &mut Option<[f64; 2]>) {
        let mut range = [0.0; 2];
        if self.parsed(name, |text| value::bounds(text, &mut range)).unwrap_or(false) {
            *target = (range != [0.0; 2]).then_some(range);
        }
    }

    /// A 32-bit integer.
    pub fn integer(&mut self, name: &str, target: &mut i32) {
        if let Some(Some(value)) = self.parsed(name, value::integer) {
            *target = value;
        }
    }

    /// As many integers as `target` holds.
    pub fn integers(&mut self, name: &str, target: &mut [i32]) {
        let wanted = target.len();
        let list = self.parsed(name, |text| match value::integers(text)? {
            list if list.is_empty() || list.len() == wanted => Ok(list),
            list => Err(format!("expected {wanted} integers, found {}", list.len())),
        });
        if let Some(list) = list.filter(|list| !list.is_empty()) {
            target.copy_from_slice(&list);
        }
    }

    /// Any number of indices from 0.
    pub fn indices(&mut self, name: &str) -> Vec<u32> {
        let index = |i: i32| u32::try_from(i).map_err(|_| format!("index {i} is negative"));
        self.parsed(name, |text| value::integers(text)?.into_iter().map(index).collect()).unwrap_or_default()
    }

    /// A bit mask, written as a signed integer.
    pub fn bits(&mut self, name: &str, target: &mut u32) {
        let mut signed = target.cast_signed();
        self.integer(name, &mut signed);
        *target = signed.cast_unsigned();
    }

    /// `true` or `false`.
    pub fn boolean(&mut self, name: &str, target: &mut bool) {
        self.keyword(name, BOOLEAN, target);
    }

    /// `true`, `false` or `auto`.
    pub fn tri(&mut self, name: &str, target: &mut Tri) {
        self.keyword(name, TRI, target);
    }

    /// One of a table of words.
    pub fn keyword<T: Copy>(&mut self, name: &str, table: &[(&str, T)], target: &mut T) {
        if let Some(value) = self.parsed(name, |text| value::keyword(text, table)) {
            *target = value;
        }
    }

    /// One word of a list of them; says whether it is known.
    pub fn word<T: Copy>(&mut self, name: &str, text: &str, table: &[(&str, T)], target: &mut T) -> bool {
        match value::keyword(text, table) {
            Ok(value) => {
                *target = value;
                true
            }
            Err(message) => {
                self.bad(name, &message);
                false
            }
        }
    }

    /// Reports an attribute that is absent or blank; says whether it is there.
    pub fn required(&mut self, name: &str) -> bool {
        let given = self.has_value(name);
        if !given {
            self.report.error(self.element, format!("attribute {} is missing", quoted(name)), "");
        }
        given
    }

    /// An orientation in any notation; at most one may be given.
    pub fn orientation(&mut self, target: &mut Orientation) {
        let notations = || super::schema::ORIENTATIONS.split_ascii_whitespace();
        if notations().filter(|name| self.has_value(name)).count() > 1 {
            let message = "more than one orientation is given";
            return self.report.error(self.element, message, "keep one of quat, axisangle, euler, xyaxes, zaxis");
        }
        let (mut three, mut four, mut six) = ([0.0; 3], [0.0; 4], [0.0; 6]);
        if self.list("quat", &mut four) {
            *target = Orientation::Quat(four);
        }
        if self.list("axisangle", &mut four) {
            *target = Orientation::AxisAngle(four);
        }
        if self.list("euler", &mut three) {
            *target = Orientation::Euler(three);
        }
        if self.list("zaxis", &mut three) {
            *target = Orientation::ZAxis(three);
        }
        if self.list("xyaxes", &mut six) {
            *target = Orientation::XyAxes(six);
        }
    }

    /// Checks the form of an attribute that has no effect: `most` numbers, or fewer if it may be short.
    pub fn ignored(&mut self, name: &str, most: usize, short: bool) {
        let mut target = vec![0.0; most];
        if short {
            self.leading(name, &mut target)
        } else {
            self.list(name, &mut target)
        };
    }

    /// Reports an attribute that the physics would need but is not supported, unless it is zero.
    pub fn neutral(&mut self, name: &str, what: &str) {
        let mut value = 0.0;
        if self.real(name, &mut value) && value != 0.0 {
            self.report.unsupported(self.element, what);
        }
    }
}
