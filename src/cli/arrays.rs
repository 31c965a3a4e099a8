//! Arrays that the user gives: every name, shape and number is checked before anything runs.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use lanesim::npz::Archive;
use lanesim::{diagnostics, suggest};

use super::failure::Failure;

/// One dimension of an expected shape, such as `nworld=4`.
#[derive(Clone, Copy)]
pub struct Dim(pub &'static str, pub usize);

/// The arrays of a file, taken out one by one. Their numbers are not read before their shapes have been checked.
pub struct Inputs<R = BufReader<File>> {
    path: PathBuf,
    archive: Archive<R>,
}

impl Inputs {
    /// All arrays of an archive that may take `limit` bytes of memory.
    pub fn read(path: &Path, limit: Option<usize>) -> Result<Inputs, Failure> {
        let archive = Archive::open(path, limit.map(|limit| limit as u64)).map_err(|e| Failure::file(path, e))?;
        Ok(Inputs { path: path.to_owned(), archive })
    }
}

impl<R: Read + Seek> Inputs<R> {
    /// Passes over an array.
    pub fn drop(&mut self, name: &str) {
        self.archive.remove(name);
    }

    /// Name and shape of the first array.
    pub fn first(&self) -> Option<(&str, &[usize])> {
        let name = self.archive.names().next()?;
        self.archive.shape(name).map(|shape| (name, shape))
    }

    /// Takes an array that must have this shape and hold finite numbers; `None` if the file does not have it.
    pub fn take(&mut self, name: &str, expected: &[Dim]) -> Result<Option<Vec<f64>>, Failure> {
        let Some(given) = self.archive.shape(name) else { return Ok(None) };
        let shape: Vec<usize> = expected.iter().map(|d| d.1).collect();
        if given != shape {
            return Err(self.wrong_shape(name, given, expected));
        }
        let Some(array) = self.archive.take(name).map_err(|e| Failure::file(&self.path, e))? else { return Ok(None) };
        let Some(values) = array.into_f64() else {
            return Err(self.error(name, "takes more memory than the system gives; ask for fewer worlds or steps"));
        };
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            let place = index(i, &shape);
            let value = values[i];
            return Err(self.error(name, &format!("holds {value} at {place:?}; every number must be finite")));
        }
        Ok(Some(values))
    }

    /// A file error about one array.
    pub fn error(&self, name: &str, message: &str) -> Failure {
        Failure::file(&self.path, format!("array `{}` {message}", diagnostics::shorten(name)))
    }

    fn wrong_shape(&self, name: &str, shape: &[usize], expected: &[Dim]) -> Failure {
        let dims: Vec<String> =
            expected.iter().map(|Dim(n, d)| if n.is_empty() { d.to_string() } else { format!("{n}={d}") }).collect();
        let last = |s: &[usize]| s.last().copied();
        let other = shape.len() == expected.len() && last(shape) != expected.last().map(|d| d.1);
        let hint = if other { "; was it made for another model?" } else { "" };
        self.error(name, &format!("has shape {shape:?}; expected [{}]{hint}", dims.join(", ")))
    }

    /// An error if arrays other than these are there: a misspelt name must not pass silently.
    pub fn check_names(&self, known: &[&str]) -> Result<(), Failure> {
        match self.archive.names().find(|name| !known.contains(name)) {
            Some(name) => {
                let remedy = suggest::or_list(name, known.iter().copied());
                Err(self.error(name, &format!("is not known here; {remedy}")))
            }
            None => Ok(()),
        }
    }
}

/// The multi-index of entry `i` of an array in C order.
fn index(i: usize, shape: &[usize]) -> Vec<usize> {
    let mut rest = i;
    let mut out: Vec<usize> = shape
        .iter()
        .rev()
        .map(|&n| {
            let k = rest % n;
            rest /= n;
            k
        })
        .collect();
    out.reverse();
    out
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use lanesim::npz::{self, Array};

    use super::*;

    fn inputs(name: &str, shape: &[usize], values: Vec<f64>) -> Inputs<Cursor<Vec<u8>>> {
        let array = Array::new(shape.to_vec(), npz::Data::F64(values)).unwrap();
        let mut bytes = Vec::new();
        npz::write_to(&mut bytes, &[(name.to_owned(), array)]).unwrap();
        Inputs { path: "u.npz".into(), archive: Archive::new(Cursor::new(bytes), None).unwrap() }
    }

    fn message(result: Result<impl Sized, Failure>) -> String {
        match result {
            Err(Failure::Input(m)) => m,
            _ => "no input failure".into(),
        }
    }

    #[test]
    fn shapes_are_checked() {
        let expected = [Dim("nworld", 4), Dim("nstep", 100), Dim("nu", 2)];
        let mut given = inputs("ctrl", &[3, 2, 2], vec![0.0; 12]);
        assert_eq!(
            message(given.take("ctrl", &expected)),
            "u.npz: array `ctrl` has shape [3, 2, 2]; expected [nworld=4, nstep=100, nu=2]"
        );
        let mut given = inputs("qpos", &[4, 3], vec![0.0; 12]);
        let text = message(given.take("qpos", &[Dim("nworld", 4), Dim("nq", 7)]));
        assert_eq!(
            text,
            "u.npz: array `qpos` has shape [4, 3]; expected [nworld=4, nq=7]; was it made for another model?"
        );
    }

    #[test]
    fn numbers_are_checked() {
        let mut values = vec![0.0; 24];
        values[23 - 1] = f64::NAN;
        let mut given = inputs("ctrl", &[2, 3, 4], values);
        let text = message(given.take("ctrl", &[Dim("nworld", 2), Dim("nstep", 3), Dim("nu", 4)]));
        assert_eq!(text, "u.npz: array `ctrl` holds NaN at [1, 2, 2]; every number must be finite");
    }

    #[test]
    fn unknown_names_are_errors_and_absent_ones_are_not() {
        let mut given = inputs("qpso", &[1], vec![0.0]);
        assert!(matches!(given.take("qpos", &[Dim("nq", 1)]), Ok(None)));
        assert_eq!(
            message(given.check_names(&["qpos", "qvel"])),
            "u.npz: array `qpso` is not known here; did you mean \"qpos\"?"
        );
    }
}
