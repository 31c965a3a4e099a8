//! The parts of the ZIP format that NumPy uses: stored and deflated members, with 64-bit sizes where they are needed.
//!
//! The directory is read and checked before any member is: two members of one name, members that share bytes of the file,
//! and sizes that cannot be are how a small file is made to expand without end. The `zip` crate keeps the last of two
//! equal names and says nothing, and reads members that overlap.

use std::io::{self, Read, Seek, SeekFrom, Write};

use super::Error;

const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;
const END_64: u32 = 0x0606_4b50;
const LOCATOR_64: u32 = 0x0706_4b50;
const END_BYTES: usize = 22;
const LOCATOR_BYTES: usize = 20;
const CENTRAL_BYTES: usize = 46;
const LOCAL_BYTES: usize = 30;
/// Longest directory that is read: room for a hundred thousand arrays.
const DIRECTORY_MAX: u64 = 16 << 20;
/// Deflate makes at most 1032 bytes of one.
const DEFLATE_MAX: u64 = 1032;

/// How a member's bytes are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    Stored,
    Deflated,
}

/// A member as the directory describes it.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub name: String,
    pub method: Method,
    pub crc: u32,
    /// Bytes in the file.
    pub packed: u64,
    /// Bytes that they expand to.
    pub size: u64,
    /// Where its bytes begin.
    pub start: u64,
}

/// Little-endian numbers from a slice; `None` beyond its end.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn bytes(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }
}

fn archive(message: impl Into<String>) -> Error {
    Error::Archive(message.into())
}

fn member(name: &str, message: impl Into<String>) -> Error {
    Error::Array { name: name.strip_suffix(".npy").unwrap_or(name).to_owned(), message: message.into() }
}

/// The members of an archive of `length` bytes.
pub(super) fn directory(reader: &mut (impl Read + Seek), length: u64) -> Result<Vec<Member>, Error> {
    let End { count, size, offset, place: end } = find_end(reader, length)?;
    if offset.checked_add(size) != Some(end) {
        return Err(archive("its directory is not where its end says; it is cut short or damaged"));
    }
    if size > DIRECTORY_MAX {
        return Err(archive(format!("its directory has {size} bytes; at most {DIRECTORY_MAX} are read")));
    }
    let bytes = read_at(reader, offset, size as usize)?;
    let mut fields = Fields(&bytes);
    let mut members = Vec::new();
    while !fields.0.is_empty() {
        members.push(entry(&mut fields)?);
    }
    if members.len() as u64 != count {
        return Err(archive(format!("its end counts {count} members, its directory has {}", members.len())));
    }
    check_names(&members)?;
    place(reader, &mut members, offset)?;
    Ok(members)
}

/// What the records at the end of the file say.
struct End {
    /// Number of members.
    count: u64,
    /// Bytes of the directory.
    size: u64,
    /// Where it begins.
    offset: u64,
    /// Where the records begin, and so the directory ends.
    place: u64,
}

/// Finds these records.
fn find_end(reader: &mut (impl Read + Seek), length: u64) -> Result<End, Error> {
    let tail = length.min((END_BYTES + usize::from(u16::MAX)) as u64);
    let bytes = read_at(reader, length - tail, tail as usize)?;
    // The comment after the record must fill the rest of the file, or what looks like a record is something else.
    let found = (0..=bytes.len().saturating_sub(END_BYTES)).rev().find_map(|at| {
        let mut fields = Fields(bytes.get(at..)?);
        let record = (fields.u32()? == END).then(|| end_record(&mut fields))??;
        (record.comment == fields.0.len()).then_some((at, record))
    });
    let Some((at, record)) = found else {
        return Err(archive("it has no end record; it is cut short or something else"));
    };
    let place = length - tail + at as u64;
    if record.disks != 0 {
        return Err(archive("it is one of several volumes"));
    }
    let end = End { count: record.count.into(), size: record.size.into(), offset: record.offset.into(), place };
    if record.count != u16::MAX && record.size != u32::MAX && record.offset != u32::MAX {
        return Ok(end);
    }
    Ok(find_end_64(reader, place)?.unwrap_or(end))
}

struct EndRecord {
    disks: u16,
    count: u16,
    size: u32,
    offset: u32,
    comment: usize,
}

fn end_record(fields: &mut Fields<'_>) -> Option<EndRecord> {
    let disks = fields.u16()? | fields.u16()?;
    let (_here, count) = (fields.u16()?, fields.u16()?);
    let (size, offset) = (fields.u32()?, fields.u32()?);
    Some(EndRecord { disks, count, size, offset, comment: usize::from(fields.u16()?) })
}

/// The same from the 64-bit records before the end record at `end`, if they are there.
fn find_end_64(reader: &mut (impl Read + Seek), end: u64) -> Result<Option<End>, Error> {
    let Some(at) = end.checked_sub(LOCATOR_BYTES as u64) else { return Ok(None) };
    let locator = read_at(reader, at, LOCATOR_BYTES)?;
    let mut fields = Fields(&locator);
    if fields.u32() != Some(LOCATOR_64) {
        return Ok(None);
    }
    let wrong = || archive("its 64-bit end record is damaged");
    let place = fields.bytes(4).and_then(|_| fields.u64()).filter(|place| *place < at).ok_or_else(wrong)?;
    let record = read_at(reader, place, 56.min((at - place) as usize))?;
    let mut fields = Fields(&record);
    let read = |fields: &mut Fields<'_>| {
        let known = fields.u32()? == END_64;
        // Its own size, versions, volumes, and the members in this one.
        fields.bytes(8 + 4 + 8 + 8)?;
        let (count, size, offset) = (fields.u64()?, fields.u64()?, fields.u64()?);
        known.then_some(End { count, size, offset, place })
    };
    read(&mut fields).map(Some).ok_or_else(wrong)
}

/// The next entry of the directory. Its `start` is still that of the local header.
fn entry(fields: &mut Fields<'_>) -> Result<Member, Error> {
    let short = || archive("its directory is damaged");
    let header = fields.bytes(CENTRAL_BYTES).ok_or_else(short)?;
    let mut h = Fields(header);
    let mut read = || {
        let known = h.u32()? == CENTRAL;
        let (system, _needed) = (h.u16()? >> 8, h.u16()?);
        let (flags, method, _time) = (h.u16()?, h.u16()?, h.u32()?);
        let (crc, packed, size) = (h.u32()?, h.u32()?, h.u32()?);
        let lengths = [h.u16()?, h.u16()?, h.u16()?].map(usize::from);
        let (disk, _internal, external, start) = (h.u16()?, h.u16()?, h.u32()?, h.u32()?);
        known.then_some((system, flags, method, crc, packed, size, lengths, disk, external, start))
    };
    let (system, flags, method, crc, packed, size, lengths, _disk, external, start) = read().ok_or_else(short)?;
    let name = fields.bytes(lengths[0]).ok_or_else(short)?;
    let extra = fields.bytes(lengths[1]).ok_or_else(short)?;
    fields.bytes(lengths[2]).ok_or_else(short)?;
    let shown = String::from_utf8_lossy(name).into_owned();
    let wrong = |message: &str| Err(member(&shown, message));
    let Ok(name) = String::from_utf8(name.to_vec()) else { return wrong("has a name that is not UTF-8") };
    if flags & 1 != 0 {
        return wrong("is encrypted; write the archive with numpy.savez");
    }
    const UNIX: u16 = 3;
    if system == UNIX && external >> 28 == 0o12 {
        return wrong("is a symbolic link, not an array");
    }
    let method = match method {
        0 => Method::Stored,
        8 => Method::Deflated,
        n => {
            let text = format!("is compressed by method {n}; write the archive with numpy.savez or savez_compressed");
            return wrong(&text);
        }
    };
    let mut sizes = [size, packed, start].map(u64::from);
    let Some(()) = widen(&mut sizes, extra) else { return wrong("has no 64-bit sizes where it needs them") };
    let [size, packed, start] = sizes;
    if method == Method::Stored && size != packed {
        return wrong(&format!("is not compressed, but {packed} bytes are said to be {size}; the file is damaged"));
    }
    if method == Method::Deflated && size / DEFLATE_MAX > packed {
        return wrong(&format!("cannot expand from {packed} bytes to {size}; the file is damaged"));
    }
    Ok(Member { name, method, crc, packed, size, start })
}

/// Takes those of size, packed size and offset that do not fit in 32 bits from the extra field.
fn widen(numbers: &mut [u64; 3], mut extra: &[u8]) -> Option<()> {
    const TOO_WIDE: u64 = u32::MAX as u64;
    if numbers.iter().all(|n| *n != TOO_WIDE) {
        return Some(());
    }
    while !extra.is_empty() {
        let mut fields = Fields(extra);
        let (tag, length) = (fields.u16()?, fields.u16()?);
        let mut body = Fields(fields.bytes(usize::from(length))?);
        if tag == 1 {
            for number in numbers.iter_mut().filter(|n| **n == TOO_WIDE) {
                *number = body.u64()?;
            }
            return Some(());
        }
        extra = fields.0;
    }
    None
}

fn check_names(members: &[Member]) -> Result<(), Error> {
    let mut names: Vec<&str> = members.iter().map(|m| &*m.name).collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(member(pair[0], "is in the archive twice")),
        None => Ok(()),
    }
}

/// Finds where members' bytes begin, and checks that no two share any and that all lie before the directory.
fn place(reader: &mut (impl Read + Seek), members: &mut [Member], directory: u64) -> Result<(), Error> {
    let mut ranges = Vec::with_capacity(members.len());
    for (i, m) in members.iter_mut().enumerate() {
        let damaged = || member(&m.name, "is not where the directory says; the file is damaged");
        let header = read_at(reader, m.start, LOCAL_BYTES).map_err(|_| damaged())?;
        let mut h = Fields(&header);
        let known = h.u32() == Some(LOCAL);
        let lengths = h.bytes(22).and_then(|_| Some(u64::from(h.u16()?) + u64::from(h.u16()?)));
        let Some(lengths) = lengths.filter(|_| known) else { return Err(damaged()) };
        let from = m.start;
        m.start = from + LOCAL_BYTES as u64 + lengths;
        match m.start.checked_add(m.packed) {
            Some(end) if end <= directory => ranges.push((from, end, i)),
            _ => return Err(member(&m.name, "ends beyond the end of the file; it is cut short or damaged")),
        }
    }
    ranges.sort_unstable();
    match ranges.windows(2).find(|pair| pair[1].0 < pair[0].1) {
        Some(pair) => {
            let other = &members[pair[0].2].name;
            Err(member(&members[pair[1].2].name, format!("shares bytes of the file with {other:?}; it is damaged")))
        }
        None => Ok(()),
    }
}

fn read_at(reader: &mut (impl Read + Seek), at: u64, bytes: usize) -> Result<Vec<u8>, Error> {
    reader.seek(SeekFrom::Start(at))?;
    let mut out = Vec::new();
    out.try_reserve_exact(bytes).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    if reader.take(bytes as u64).read_to_end(&mut out)? < bytes {
        return Err(archive("it is cut short"));
    }
    Ok(out)
}

/// Writes members one after another, and at the end their directory. Never goes back, so that devices can be written too.
pub(super) struct Writer<W> {
    inner: W,
    at: u64,
    directory: Vec<u8>,
    count: u64,
}

impl<W: Write> Writer<W> {
    pub(super) fn new(inner: W) -> Self {
        Writer { inner, at: 0, directory: Vec::new(), count: 0 }
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.inner.write_all(bytes)
    }

    /// Begins a member of `size` bytes with the checksum `crc`; exactly these must follow by `write`.
    pub(super) fn member(&mut self, name: &str, size: u64, crc: u32) -> io::Result<()> {
        let length = u16::try_from(name.len()).map_err(|_| io::Error::other("the name of an array is too long"))?;
        let place = self.at;
        // 64-bit sizes in every member, as numpy.savez writes them.
        let extra = |numbers: &[u64]| {
            let mut out = [1u16.to_le_bytes(), (8 * numbers.len() as u16).to_le_bytes()].concat();
            out.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
            out
        };
        let common = |out: &mut Vec<u8>, extra: &[u8]| {
            // Version 4.5; names in UTF-8; stored; the first of January 1980.
            for n in [45u16, 1 << 11, 0, 0, 0x21] {
                out.extend(n.to_le_bytes());
            }
            for n in [crc, u32::MAX, u32::MAX] {
                out.extend(n.to_le_bytes());
            }
            out.extend(length.to_le_bytes());
            out.extend((extra.len() as u16).to_le_bytes());
        };
        let local_extra = extra(&[size, size]);
        let mut local = LOCAL.to_le_bytes().to_vec();
        common(&mut local, &local_extra);
        local.extend(name.as_bytes());
        local.extend(local_extra);
        self.put(&local)?;
        let central_extra = extra(&[size, size, place]);
        self.directory.extend(CENTRAL.to_le_bytes());
        self.directory.extend(45u16.to_le_bytes());
        common(&mut self.directory, &central_extra);
        // No comment, volume or attributes; the offset is in the extra field.
        self.directory.extend([0; 10]);
        self.directory.extend(u32::MAX.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.directory.extend(central_extra);
        self.count += 1;
        Ok(())
    }

    /// Writes the directory and the records at the end.
    pub(super) fn finish(mut self) -> io::Result<()> {
        let (start, directory) = (self.at, std::mem::take(&mut self.directory));
        self.put(&directory)?;
        let place = self.at;
        let mut end = END_64.to_le_bytes().to_vec();
        end.extend(44u64.to_le_bytes());
        end.extend([45u16, 45].map(u16::to_le_bytes).concat());
        end.extend([0; 8]);
        end.extend([self.count, self.count, directory.len() as u64, start].map(u64::to_le_bytes).concat());
        end.extend(LOCATOR_64.to_le_bytes());
        end.extend([0; 4]);
        end.extend(place.to_le_bytes());
        end.extend(1u32.to_le_bytes());
        end.extend(END.to_le_bytes());
        end.extend([0; 4]);
        end.extend([u16::MAX; 2].map(u16::to_le_bytes).concat());
        end.extend([u32::MAX; 2].map(u32::to_le_bytes).concat());
        end.extend([0; 2]);
        self.put(&end)?;
        self.inner.flush()
    }
}

impl<W: Write> Write for Writer<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.inner.write(bytes)?;
        self.at += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
