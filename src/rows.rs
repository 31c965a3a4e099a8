//! Arrays that belong to the caller: rows of numbers to read from and to write to, without a copy between.

use crate::error::Error;
use crate::memory;

/// Numbers to read.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a> {
    /// Double precision.
    F64(&'a [f64]),
    /// Single precision.
    F32(&'a [f32]),
}

impl Values<'_> {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Values::F64(x) => x.len(),
            Values::F32(x) => x.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Calls `f` with every number of a range and its place in the range.
    pub(crate) fn for_each(&self, range: std::ops::Range<usize>, mut f: impl FnMut(usize, f64)) {
        match self {
            Values::F64(x) => x[range].iter().enumerate().for_each(|(i, x)| f(i, *x)),
            Values::F32(x) => x[range].iter().enumerate().for_each(|(i, x)| f(i, f64::from(*x))),
        }
    }

    /// An error that names the first number that is not finite; `shape` is that of the array called `name`.
    ///
    /// ```
    /// use lanesim::rows::Values;
    ///
    /// let error = Values::F64(&[0.0, 1.0, f64::NAN, 3.0]).check_finite("qpos", &[2, 2]).unwrap_err();
    /// assert_eq!(error.to_string(), "array `qpos` holds NaN at [1, 0]; every number must be finite");
    /// ```
    ///
    /// # Errors
    ///
    /// That, or that an array of this shape has another number of entries.
    pub fn check_finite(&self, name: &str, shape: &[usize]) -> Result<(), Error> {
        if memory::product(shape) != Some(self.len()) {
            let given = self.len();
            return Err(Error::Input(format!(
                "array `{name}` has {given} numbers; expected as many as its shape {shape:?} has"
            )));
        }
        let found = match self {
            Values::F64(x) => x.iter().position(|x| !x.is_finite()).map(|i| (i, x[i])),
            Values::F32(x) => x.iter().position(|x| !x.is_finite()).map(|i| (i, f64::from(x[i]))),
        };
        let Some((mut i, value)) = found else { return Ok(()) };
        let mut place = vec![0; shape.len()];
        for (k, n) in place.iter_mut().zip(shape).rev() {
            (*k, i) = (i % n, i / n);
        }
        Err(Error::Input(format!("array `{name}` holds {value} at {place:?}; every number must be finite")))
    }
}

/// One row of numbers per world, in an array that may hold more: the row of world `w` begins at `offset + w * stride`.
/// A stride of 0 gives every world the same row.
#[derive(Clone, Copy, Debug)]
pub struct Strided<'a> {
    /// The array.
    pub values: Values<'a>,
    /// Where world 0's row begins.
    pub offset: usize,
    /// From one world's row to the next.
    pub stride: usize,
}

impl<'a> Strided<'a> {
    /// An array that holds one row of `width` numbers per world and nothing else; if it holds one row only, every world
    /// has that.
    pub fn new(values: Values<'a>, width: usize) -> Self {
        Strided { values, offset: 0, stride: if values.len() == width { 0 } else { width } }
    }

    /// Whether the rows of `width` numbers of all worlds lie inside the array.
    pub fn fits(&self, nworld: usize, width: usize) -> bool {
        let last = nworld.saturating_sub(1).checked_mul(self.stride).and_then(|at| at.checked_add(self.offset));
        let end = last.and_then(|at| at.checked_add(width));
        nworld == 0 || width == 0 || end.is_some_and(|end| end <= self.values.len())
    }

    /// Calls `f` with every number of a world's row and its place in the row.
    pub(crate) fn row(&self, world: usize, width: usize, f: impl FnMut(usize, f64)) {
        let start = self.offset + world * self.stride;
        if width > 0 {
            self.values.for_each(start..start + width, f);
        }
    }
}

/// An array to write to: one row per world, or per world and step.
#[derive(Debug)]
pub enum Rows<'a> {
    /// Double precision.
    F64(&'a mut [f64]),
    /// Single precision.
    F32(&'a mut [f32]),
    /// Integers, for outputs that are such.
    I32(&'a mut [i32]),
    /// A list per world, for outputs of which every world has another number.
    Lists(&'a mut [Vec<f64>]),
}

impl<'a> Rows<'a> {
    /// Number of entries.
    pub fn len(&self) -> usize {
        match self {
            Rows::F64(x) => x.len(),
            Rows::F32(x) => x.len(),
            Rows::I32(x) => x.len(),
            Rows::Lists(x) => x.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Takes the first `n` entries away and returns them.
    pub(crate) fn take(&mut self, n: usize) -> Rows<'a> {
        fn part<'a, T>(slice: &mut &'a mut [T], n: usize) -> &'a mut [T] {
            let (mine, rest) = std::mem::take(slice).split_at_mut(n);
            *slice = rest;
            mine
        }
        match self {
            Rows::F64(x) => Rows::F64(part(x, n)),
            Rows::F32(x) => Rows::F32(part(x, n)),
            Rows::I32(x) => Rows::I32(part(x, n)),
            Rows::Lists(x) => Rows::Lists(part(x, n)),
        }
    }

    /// Writes a block of a matrix, which begins at entry `at` and whose rows are `stride` apart: height and width, and the numbers of each row,
    /// from place `from` of what is given for it on. Nothing where no numbers are wanted.
    pub(crate) fn block<const N: usize>(
        &mut self,
        (at, stride): (usize, usize),
        (height, width): (usize, usize),
        from: usize,
        row: impl Fn(usize) -> [f64; N],
    ) {
        let height = if self.is_empty() { 0 } else { height };
        for i in 0..height {
            self.write(at + i * stride, &row(i)[from..from + width]);
        }
    }

    /// Writes `count` numbers from entry `at` on.
    pub(crate) fn fill(&mut self, at: usize, count: usize, numbers: impl Iterator<Item = f64>) {
        match self {
            Rows::F64(x) => x[at..at + count].iter_mut().zip(numbers).for_each(|(to, x)| *to = x),
            Rows::F32(x) => x[at..at + count].iter_mut().zip(numbers).for_each(|(to, x)| *to = x as f32),
            Rows::I32(x) => x[at..at + count].iter_mut().zip(numbers).for_each(|(to, x)| *to = x as i32),
            Rows::Lists(_) => {}
        }
    }

    /// Writes the first `count` numbers from entry `at` on.
    #[inline(always)]
    pub(crate) fn put<const N: usize>(&mut self, at: usize, numbers: &[f64; N], count: usize) {
        match self {
            Rows::F64(x) if count == N => x[at..at + N].copy_from_slice(numbers),
            _ => self.write(at, &numbers[..count]),
        }
    }

    /// Writes numbers from entry `at` on, or the list of row `at`.
    pub(crate) fn write(&mut self, at: usize, values: &[f64]) {
        match self {
            Rows::F64(x) => x[at..at + values.len()].copy_from_slice(values),
            Rows::F32(x) => x[at..].iter_mut().zip(values).for_each(|(to, x)| *to = *x as f32),
            Rows::I32(x) => x[at..].iter_mut().zip(values).for_each(|(to, x)| *to = *x as i32),
            Rows::Lists(x) => {
                x[at].clear();
                x[at].extend_from_slice(values);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_found() {
        let numbers = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let columns = Strided { values: Values::F64(&numbers), offset: 1, stride: 3 };
        assert!(columns.fits(2, 2) && !columns.fits(2, 3) && !columns.fits(3, 1));
        let mut seen = Vec::new();
        columns.row(1, 2, |i, x| seen.push((i, x)));
        assert_eq!(seen, [(0, 4.0), (1, 5.0)]);
        let one = Strided::new(Values::F32(&[7.0]), 1);
        assert!(one.fits(1000, 1));
        one.row(999, 1, |_, x| assert_eq!(x, 7.0));
    }

    #[test]
    fn figures_that_do_not_fit_are_no_rows() {
        let numbers = [0.0; 4];
        for (offset, stride) in [(usize::MAX, 1), (1, usize::MAX), (usize::MAX - 1, 0), (2, usize::MAX / 2)] {
            assert!(!Strided { values: Values::F64(&numbers), offset, stride }.fits(4, 2), "{offset} {stride}");
        }
        for shape in [&[][..], &[0], &[3], &[2, 0], &[usize::MAX, 2], &[2, 3]] {
            for values in [Values::F64(&[f64::NAN; 4]), Values::F32(&[0.0; 4])] {
                let message = values.check_finite("qpos", shape).unwrap_err().to_string();
                assert!(message.starts_with("array `qpos` has 4 numbers"), "{message}");
            }
        }
        assert!(Values::F64(&[]).check_finite("act", &[5, 0]).is_ok());
    }

    #[test]
    fn shares_are_taken_in_order() {
        let mut numbers = [0_f32; 5];
        let mut rows = Rows::F32(&mut numbers);
        let mut first = rows.take(2);
        first.write(0, &[1.0, 2.0]);
        rows.write(1, &[4.0]);
        assert_eq!((first.len(), rows.len()), (2, 3));
        assert_eq!(numbers, [1.0, 2.0, 0.0, 4.0, 0.0]);
    }
}
