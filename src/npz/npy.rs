//! One array as NumPy stores it: magic, a dictionary as text, the raw entries.
//!
//! ```text
//! \x93NUMPY  major minor  length of the text (u16, or u32 from version 2 on)
//! {'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }   padded with blanks to a multiple of 64, newline
//! entries
//! ```

use std::io::{self, Read, Write};

use super::array::{Array, Data, each, entries};

const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header text that is read. NumPy itself refuses more than 10 000 characters.
const TEXT_MAX: usize = 16_384;
/// Most dimensions, as in NumPy.
const DIMS_MAX: usize = 64;

/// What the dictionary says, and how long all was up to the entries.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    descr: String,
    fortran: bool,
    pub shape: Vec<usize>,
    length: u64,
}

impl Header {
    /// The element type without its byte order, and the bytes of an element.
    fn kind(&self) -> Result<(&str, usize), String> {
        let (_, kind) = self.descr.split_at_checked(1).ok_or("has no element type")?;
        let known = matches!(kind, "f8" | "f4" | "i8" | "i4" | "i2" | "i1" | "u8" | "u4" | "u2" | "u1" | "b1");
        let size = kind.get(1..).and_then(|n| n.parse().ok()).filter(|_| known);
        Ok((kind, size.ok_or_else(|| unsupported(&self.descr))?))
    }

    /// An error if entries of this type and number do not fill a member of `size` bytes.
    pub(super) fn check(&self, size: u64) -> Result<(), String> {
        let bytes = entries(&self.shape).and_then(|n| n.checked_mul(self.kind().ok()?.1));
        self.kind()?;
        let impossible = || format!("has an impossible shape {:?}", self.shape);
        let whole = (bytes.ok_or_else(impossible)? as u64).checked_add(self.length).ok_or_else(impossible)?;
        if whole == size {
            return Ok(());
        }
        let more = if size > whole { "more" } else { "fewer" };
        Err(format!("has {more} bytes than its shape {:?} says; the file is damaged", self.shape))
    }

    /// Number of entries; of a checked header.
    pub(super) fn entries(&self) -> u64 {
        entries(&self.shape).unwrap_or(0) as u64
    }
}

/// Reads the entries that a checked header announces.
pub(super) fn read_data(reader: &mut dyn Read, header: Header) -> Result<Array, String> {
    let (kind, _) = header.kind()?;
    let mut source = Source { reader, n: header.entries() as usize, big_endian: header.descr.starts_with('>') };
    let data = match kind {
        "f8" => Data::F64(source.numbers(f64::from_le_bytes)?),
        "f4" => Data::F32(source.numbers(f32::from_le_bytes)?),
        "i8" => Data::I64(source.numbers(i64::from_le_bytes)?),
        "i4" => Data::I32(source.numbers(i32::from_le_bytes)?),
        "i2" => Data::I32(source.numbers(|b| i16::from_le_bytes(b).into())?),
        "i1" => Data::I32(source.numbers(|b| i8::from_le_bytes(b).into())?),
        "u8" => Data::U64(source.numbers(u64::from_le_bytes)?),
        "u4" => Data::U32(source.numbers(u32::from_le_bytes)?),
        "u2" => Data::U32(source.numbers(|b| u16::from_le_bytes(b).into())?),
        _ => Data::U32(source.numbers(|b| u8::from_le_bytes(b).into())?),
    };
    let data = if header.fortran { each!(data, v => transpose(&v, &header.shape)?.into()) } else { data };
    Array::new(header.shape, data).ok_or_else(|| "is inconsistent".into())
}

fn unsupported(descr: &str) -> String {
    format!("has element type '{descr}', which is not a real number; convert it with .astype(numpy.float64)")
}

/// Reads everything before the entries.
pub(super) fn read_header(reader: &mut dyn Read) -> Result<Header, String> {
    let short = |e: io::Error| format!("is cut short or unreadable ({e})");
    let mut start = [0; 8];
    reader.read_exact(&mut start).map_err(short)?;
    if &start[..6] != MAGIC {
        return Err("is not in NumPy's format".into());
    }
    let (digits, length) = match start[6] {
        1 => {
            let mut n = [0; 2];
            reader.read_exact(&mut n).map_err(short)?;
            (2, u16::from_le_bytes(n) as usize)
        }
        2 | 3 => {
            let mut n = [0; 4];
            reader.read_exact(&mut n).map_err(short)?;
            (4, u32::from_le_bytes(n) as usize)
        }
        v => return Err(format!("has version {v} of NumPy's format; versions 1 to 3 are known")),
    };
    if length > TEXT_MAX {
        return Err(format!("has a header of {length} bytes; at most {TEXT_MAX} are read"));
    }
    let mut text = vec![0; length];
    reader.read_exact(&mut text).map_err(short)?;
    let text = std::str::from_utf8(&text).map_err(|_| "has a header that is not text".to_string())?;
    let (descr, fortran, shape) = parse_header(text)?;
    Ok(Header { descr, fortran, shape, length: (start.len() + digits + length) as u64 })
}

/// Parses `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }`, the keys in any order.
fn parse_header(text: &str) -> Result<(String, bool, Vec<usize>), String> {
    let malformed = || "has a malformed header".to_string();
    let (mut descr, mut fortran, mut shape) = (None, None, None);
    let mut rest = text.trim().strip_prefix('{').ok_or_else(malformed)?.trim_start();
    while !rest.starts_with('}') {
        let (key, after) = quoted(rest).ok_or_else(malformed)?;
        rest = after.trim_start().strip_prefix(':').ok_or_else(malformed)?.trim_start();
        match key {
            "descr" if rest.starts_with('[') => return Err("is a structured array; only plain numbers are read".into()),
            "descr" => {
                let (value, after) = quoted(rest).ok_or_else(malformed)?;
                (descr, rest) = (Some(value.to_owned()), after);
            }
            "fortran_order" => {
                let word = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_alphabetic()).len();
                fortran = Some(rest[..word].to_ascii_lowercase().parse().map_err(|_| malformed())?);
                rest = &rest[word..];
            }
            "shape" => {
                let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(malformed)?;
                (shape, rest) = (Some(parse_shape(inside).ok_or_else(malformed)?), after);
            }
            _ => return Err(malformed()),
        }
        rest = rest.trim_start();
        rest = rest.strip_prefix(',').unwrap_or(rest).trim_start();
    }
    let (Some(descr), Some(fortran), Some(shape)) = (descr, fortran, shape) else { return Err(malformed()) };
    Ok((descr, fortran, shape))
}

/// The text in quotes at the start, and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}

fn parse_shape(text: &str) -> Option<Vec<usize>> {
    let text = text.trim();
    let text = text.strip_suffix(',').unwrap_or(text);
    if text.is_empty() {
        return Some(Vec::new());
    }
    // Python 2 wrote long integers with an L.
    let shape: Option<Vec<usize>> = text.split(',').map(|n| n.trim().trim_end_matches('L').parse().ok()).collect();
    shape.filter(|s| s.len() <= DIMS_MAX)
}

/// Where entries come from, and how many.
struct Source<'a> {
    reader: &'a mut dyn Read,
    n: usize,
    big_endian: bool,
}

impl Source<'_> {
    /// The entries, converted as they arrive. Memory is taken as they do, so a length that is not there costs nothing.
    fn numbers<const N: usize, T>(&mut self, from_le: impl Fn([u8; N]) -> T) -> Result<Vec<T>, String> {
        const CHUNK: usize = 1 << 13;
        let mut out = Vec::new();
        let mut bytes = vec![[0u8; N]; CHUNK.min(self.n)];
        while out.len() < self.n {
            let count = CHUNK.min(self.n - out.len());
            let chunk = &mut bytes[..count];
            self.reader.read_exact(chunk.as_flattened_mut()).map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof => "has fewer bytes than its shape says; the file is damaged".to_owned(),
                _ => format!("cannot be read: {e}"),
            })?;
            // Doubling, but never beyond what is announced.
            if out.capacity() < out.len() + count {
                let room = out.len().max(CHUNK).min(self.n - out.len());
                out.try_reserve_exact(room).map_err(|_| no_memory(self.n * size_of::<T>()))?;
            }
            for c in chunk {
                if self.big_endian {
                    c.reverse();
                }
                out.push(from_le(*c));
            }
        }
        Ok(out)
    }
}

fn no_memory(bytes: usize) -> String {
    format!("takes {bytes} bytes of memory, which the system does not give")
}

/// Fortran order (first index fastest) to C order (last index fastest).
fn transpose<T: Copy>(fortran: &[T], shape: &[usize]) -> Result<Vec<T>, String> {
    let mut index = vec![0; shape.len()];
    let mut out = Vec::new();
    out.try_reserve_exact(fortran.len()).map_err(|_| no_memory(size_of_val(fortran)))?;
    for _ in 0..fortran.len() {
        let offset = index.iter().zip(shape).rev().fold(0, |offset, (&i, &n)| offset * n + i);
        out.push(fortran[offset]);
        for (i, &n) in index.iter_mut().zip(shape).rev() {
            *i += 1;
            if *i < n {
                break;
            }
            *i = 0;
        }
    }
    Ok(out)
}

macro_rules! from_vec {
    ($($variant:ident $t:ty),*) => {
        $(impl From<Vec<$t>> for Data {
            fn from(v: Vec<$t>) -> Data {
                Data::$variant(v)
            }
        })*
    };
}
from_vec!(F64 f64, F32 f32, I32 i32, I64 i64, U32 u32, U64 u64);

/// Writes one array.
pub(super) fn write(writer: &mut impl Write, array: &Array) -> io::Result<()> {
    let descr = match array.data() {
        Data::F64(_) => "<f8",
        Data::F32(_) => "<f4",
        Data::I32(_) => "<i4",
        Data::I64(_) => "<i8",
        Data::U32(_) => "<u4",
        Data::U64(_) => "<u8",
    };
    let shape: String = array.shape().iter().map(|n| format!("{n}, ")).collect();
    // NumPy writes (3,) and (3, 4): a comma at the end only where Python needs it.
    let shape = if array.shape().len() == 1 { shape.trim_end() } else { shape.trim_end_matches(", ") };
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    let before = MAGIC.len() + 4;
    let padded = (before + text.len() + 1).next_multiple_of(64);
    text.extend(std::iter::repeat_n(' ', padded - before - text.len() - 1));
    text.push('\n');
    writer.write_all(MAGIC)?;
    writer.write_all(&[1, 0])?;
    writer.write_all(&(text.len() as u16).to_le_bytes())?;
    writer.write_all(text.as_bytes())?;
    each!(array.data(), v => write_numbers(writer, v, |x| x.to_le_bytes()))
}

/// Writes numbers through a small buffer, so that no second copy of a large array is made.
fn write_numbers<const N: usize, T: Copy>(
    writer: &mut impl Write,
    values: &[T],
    to_le: impl Fn(T) -> [u8; N],
) -> io::Result<()> {
    for chunk in values.chunks(8192) {
        let bytes: Vec<u8> = chunk.iter().flat_map(|&x| to_le(x)).collect();
        writer.write_all(&bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(text: &str) -> Option<(String, bool, Vec<usize>)> {
        parse_header(text).ok()
    }

    #[test]
    fn headers() {
        let some = |d: &str, f, s: &[usize]| Some((d.to_owned(), f, s.to_vec()));
        assert_eq!(
            header("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }\n"),
            some("<f8", false, &[3, 4])
        );
        assert_eq!(header("{'shape':(),'fortran_order':True,'descr':\"|b1\"}"), some("|b1", true, &[]));
        assert_eq!(header("{'descr': '>i4', 'fortran_order': False, 'shape': (7L,), }"), some(">i4", false, &[7]));
        for bad in [
            "",
            "{",
            "{}",
            "{'descr'",
            "{'descr': ",
            "{'descr': '<f8'}",
            "{'descr': '<f8', 'fortran_order': Maybe, 'shape': (1,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (1, ((((((2}",
            "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (1,), 'é': 2}",
            "é",
        ] {
            assert_eq!(header(bad), None, "{bad}");
        }
    }

    #[test]
    fn fortran_order_is_undone() {
        // numpy: a = arange(6).reshape(2, 3); a.flatten("F") is 0 3 1 4 2 5.
        assert_eq!(transpose(&[0, 3, 1, 4, 2, 5], &[2, 3]).unwrap(), [0, 1, 2, 3, 4, 5]);
        let c: Vec<i32> = (0..24).collect();
        let f: Vec<i32> = (0..24)
            .map(|k| {
                let (i, j, l) = (k % 2, k / 2 % 3, k / 6);
                c[((i * 3 + j) * 4 + l) as usize]
            })
            .collect();
        assert_eq!(transpose(&f, &[2, 3, 4]).unwrap(), c);
        assert_eq!(transpose(&[5], &[]).unwrap(), [5]);
    }
}
