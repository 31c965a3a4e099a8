//! Archives of arrays: sound ones, whose headers, directories and bytes are then changed.

use std::io::{Cursor, Write};

use lanesim::npz::{self, Array, Data};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::random::Random;

/// The text of an array's header.
fn header(random: &mut Random) -> String {
    const TYPES: [&str; 14] =
        ["<f8", ">f8", "<f4", "|u1", "|b1", "<i8", ">i2", "<u4", "|O", "<c16", "<f16", "<f", "f8", "<é8"];
    const SHAPES: [&str; 15] = [
        "(3,)",
        "(1, 3)",
        "()",
        "(0,)",
        "(3, 0, 99999999999)",
        "(1099511627776, 1099511627776, 0)",
        "(-1,)",
        "(4294967296, 4294967296)",
        "(2305843009213693951,)",
        "(18446744073709551615,)",
        "(3L,)",
        "3",
        "(1, (2",
        "(3,,)",
        "(1,1,1,1,1,1,1,1,1,1,1,1,1,3)",
    ];
    let descr = if random.one_in(2) { TYPES[0] } else { *random.pick(&TYPES) };
    let shape = if random.one_in(2) { SHAPES[0] } else { *random.pick(&SHAPES) };
    let order = *random.pick(&["False", "False", "True", "Maybe"]);
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    match random.below(12) {
        0 => text.truncate(random.below(8)),
        1 => text.insert_str(1, "'descr': '<f8', "),
        2 => text = "{".repeat(9000),
        _ => {}
    }
    text
}

/// An array's bytes.
fn entry(random: &mut Random) -> Vec<u8> {
    let text = header(random);
    let version = if random.one_in(8) { random.below(5) as u8 } else { 1 };
    let mut out = b"\x93NUMPY".to_vec();
    out.extend([version, 0]);
    let length = if random.one_in(10) { random.next() as u32 } else { text.len() as u32 };
    match version {
        2.. => out.extend(length.to_le_bytes()),
        _ => out.extend((length as u16).to_le_bytes()),
    }
    out.extend(text.as_bytes());
    let numbers = if random.one_in(4) { random.below(40) } else { 24 };
    out.extend((0..numbers).map(|_| random.next() as u8));
    out
}

fn names(random: &mut Random) -> &'static str {
    const NAMES: [&str; 10] = ["qpos", "qvel", "ctrl", "time", "act", "a", "", "é", "../x", "xfrc_applied"];
    random.pick::<&str>(&NAMES)
}

/// An archive, sound or not.
pub fn archive(random: &mut Random) -> Vec<u8> {
    let mut bytes = match random.below(3) {
        0 => ours(random),
        _ => forged(random).unwrap_or_default(),
    };
    for _ in 0..random.below(4) {
        damage(&mut bytes, random);
    }
    bytes
}

fn ours(random: &mut Random) -> Vec<u8> {
    let mut arrays = Vec::new();
    for _ in 0..random.below(4) {
        let n = random.below(20);
        let values: Vec<f64> = (0..n).map(|_| random.finite()).collect();
        let data =
            if random.one_in(2) { Data::F64(values) } else { Data::F32(values.iter().map(|x| *x as f32).collect()) };
        arrays.extend(Array::new(vec![1, n], data).map(|array| (names(random).to_owned(), array)));
    }
    let mut out = Vec::new();
    // Two of one name are refused, which leaves the start of a file.
    let _ = npz::write_to(&mut out, &arrays);
    out
}

fn forged(random: &mut Random) -> zip::result::ZipResult<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for _ in 0..1 + random.below(3) {
        let method = if random.one_in(2) { CompressionMethod::Stored } else { CompressionMethod::Deflated };
        let options = SimpleFileOptions::default().compression_method(method).large_file(random.one_in(4));
        let end = if random.one_in(10) { "" } else { ".npy" };
        if zip.start_file(format!("{}{end}", names(random)), options).is_ok() {
            let mut bytes = entry(random);
            if random.one_in(12) {
                bytes.resize(bytes.len() + random.below(100_000), 0);
            }
            zip.write_all(&bytes)?;
        }
    }
    Ok(zip.finish()?.into_inner())
}

/// Changes bytes, mostly where the directory is.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    const NUMBERS: [u32; 10] =
        [0, 1, 0xffff, 0xffff_ffff, 0xffff_fffe, 0x8000_0000, 0x0605_4b50, 0x0201_4b50, 20, 0x7fff_ffff];
    if bytes.is_empty() {
        return bytes.extend(b"PK");
    }
    let at =
        if random.one_in(2) { random.below(bytes.len()) } else { bytes.len() - 1 - random.below(bytes.len().min(160)) };
    match random.below(8) {
        0 => bytes.truncate(at),
        1 => {
            let piece = bytes[at..].to_vec();
            bytes.extend(piece);
        }
        2 => bytes.insert(at, random.next() as u8),
        3 | 4 => bytes[at] ^= 1 << random.below(8),
        5 => {
            let from = random.below(bytes.len());
            let n = random.below(64).min(bytes.len() - from).min(bytes.len() - at);
            bytes.copy_within(from..from + n, at);
        }
        _ => {
            let number = random.pick(&NUMBERS).to_le_bytes();
            let n = (bytes.len() - at).min(*random.pick(&[2, 4]));
            bytes[at..at + n].copy_from_slice(&number[..n]);
        }
    }
}
