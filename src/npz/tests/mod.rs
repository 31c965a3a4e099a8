//! Round trips, files from NumPy, and hostile files.

use std::io::{Cursor, Write};

use ::zip::write::SimpleFileOptions;
use ::zip::{CompressionMethod, ZipWriter};

use super::*;

mod hostile;

/// `numpy.savez(file, q=numpy.array([[1.5, -2.0]]))`, NumPy 2.4.
const FROM_NUMPY: &str = "504b03042d00000000000000210075d8b17effffffffffffffff05001400712e6e7079010010009000000000000000900000\
    0000000000934e554d5059010076007b276465736372273a20273c6638272c2027666f727472616e5f6f72646572273a2046\
    616c73652c20277368617065273a2028312c2032292c207d2020202020202020202020202020202020202020202020202020\
    20202020202020202020202020202020202020202020202020202020202020200a000000000000f83f00000000000000c050\
    4b01022d032d00000000000000210075d8b17e9000000090000000050000000000000000000000800100000000712e6e7079\
    504b0506000000000100010033000000c70000000000";

fn from_numpy() -> Vec<u8> {
    let digits: Vec<u8> = FROM_NUMPY.bytes().filter(u8::is_ascii_hexdigit).collect();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.chunks(2).map(byte).collect()
}

fn read_bytes(bytes: &[u8]) -> Result<BTreeMap<String, Array>, Error> {
    read_from(Cursor::new(bytes))
}

/// An archive with one entry `a.npy` of these bytes.
fn archive(entry: &[u8], method: CompressionMethod) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("a.npy", SimpleFileOptions::default().compression_method(method)).unwrap();
    zip.write_all(entry).unwrap();
    zip.finish().unwrap().into_inner()
}

/// A version 1.0 array with this header text and these raw entries.
fn entry(text: &str, raw: &[u8]) -> Vec<u8> {
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((text.len() as u16).to_le_bytes());
    out.extend(text.as_bytes());
    out.extend(raw);
    out
}

fn array(text: &str, raw: &[u8]) -> Result<Array, String> {
    read_bytes(&archive(&entry(text, raw), CompressionMethod::Deflated))
        .map(|mut m| m.remove("a").unwrap())
        .map_err(|e| e.to_string())
}

#[test]
fn a_file_from_numpy() {
    let arrays = read_bytes(&from_numpy()).unwrap();
    assert_eq!(arrays.keys().collect::<Vec<_>>(), ["q"]);
    assert_eq!(arrays["q"].shape(), [1, 2]);
    assert_eq!(arrays["q"].to_f64().as_ref(), [1.5, -2.0]);
}

#[test]
fn round_trip() {
    let make = |shape: &[usize], data: Data| Array::new(shape.to_vec(), data).unwrap();
    let arrays = [
        ("double".to_owned(), make(&[2, 3], Data::F64(vec![1.0, -0.0, f64::NAN, 1e300, 5e-324, 6.0]))),
        ("single".to_owned(), make(&[4], Data::F32(vec![1.5, 2.5, -3.5, f32::INFINITY]))),
        ("deep/name".to_owned(), make(&[1, 2, 1], Data::I32(vec![i32::MIN, 7]))),
        ("long".to_owned(), make(&[], Data::I64(vec![-(1 << 40)]))),
        ("unsigned".to_owned(), make(&[0, 5], Data::U32(vec![]))),
        ("wide".to_owned(), make(&[20_000], Data::U64((0..20_000).collect()))),
    ];
    let mut file = Cursor::new(Vec::new());
    write_to(&mut file, &arrays).unwrap();
    let back = read_from(file).unwrap();
    assert_eq!(back.len(), arrays.len());
    for (name, array) in &arrays {
        assert_eq!(back[name].shape(), array.shape());
        // NaN differs from itself, its text does not.
        assert_eq!(format!("{:?}", back[name].data()), format!("{:?}", array.data()));
    }
}

#[test]
fn every_numeric_type_and_order() {
    let of = |descr: &str, raw: &[u8]| {
        array(&format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1,)}}"), raw).unwrap().to_f64()[0]
    };
    assert_eq!(of(">f8", &1.25f64.to_be_bytes()), 1.25);
    assert_eq!(of(">f4", &1.25f32.to_be_bytes()), 1.25);
    assert_eq!(of("<i2", &(-3i16).to_le_bytes()), -3.0);
    assert_eq!(of(">i8", &(-3i64).to_be_bytes()), -3.0);
    assert_eq!(of("|i1", &[0xff]), -1.0);
    assert_eq!(of("|b1", &[1]), 1.0);
    assert_eq!(of(">u2", &[1, 0]), 256.0);
    assert_eq!(of("<u8", &9u64.to_le_bytes()), 9.0);
    let fortran = array("{'descr': '|u1', 'fortran_order': True, 'shape': (2, 3)}", &[0, 3, 1, 4, 2, 5]).unwrap();
    assert_eq!(fortran.to_f64().as_ref(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
}

#[test]
fn an_empty_archive_has_no_arrays() {
    let mut file = Cursor::new(Vec::new());
    write_to(&mut file, &[]).unwrap();
    assert!(read_from(file).unwrap().is_empty());
}

#[test]
fn errors_name_the_array_and_the_problem() {
    for (text, raw, expected) in [
        ("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", &b"x"[..], "'|O', which is not a real number"),
        ("{'descr': '<U3', 'fortran_order': False, 'shape': (1,)}", b"x", "'<U3', which is not a real number"),
        ("{'descr': '<c16', 'fortran_order': False, 'shape': (1,)}", b"x", "not a real number"),
        ("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,)}", b"x", "structured array"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (2,)}", &[0; 8], "fewer bytes"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (2,)}", &[0; 24], "more bytes"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000, 4000000000)}", b"", "impossible shape"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (2305843009213693951,)}", b"", "impossible shape"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (1152921504606846975,)}", b"", "fewer bytes"),
        ("nonsense", b"", "malformed header"),
    ] {
        let message = array(text, raw).unwrap_err();
        assert!(message.starts_with("array `a`: ") && message.contains(expected), "{message}");
    }
}

#[test]
fn a_forged_header_length_allocates_nothing() {
    let mut forged = b"\x93NUMPY\x02\x00".to_vec();
    forged.extend(u32::MAX.to_le_bytes());
    let message = read_bytes(&archive(&forged, CompressionMethod::Stored)).unwrap_err().to_string();
    assert!(message.contains("header of 4294967295 bytes"), "{message}");
}

#[test]
fn truncated_and_damaged_files_are_errors() {
    let whole = from_numpy();
    for n in 0..whole.len() {
        assert!(read_bytes(&whole[..n]).is_err(), "cut to {n} bytes");
    }
    // A flipped byte may go unnoticed (in an unused field) but never panics.
    for i in 0..whole.len() {
        for bit in 0..8 {
            let mut damaged = whole.clone();
            damaged[i] ^= 1 << bit;
            let _ = read_bytes(&damaged);
        }
    }
}

#[test]
fn the_goldens_can_be_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens");
    let arrays = read(&folder.join("ant.npz")).unwrap();
    assert_eq!(arrays["size/nv"].to_f64().as_ref(), [14.0]);
    assert_eq!(arrays["out/qM"].shape(), [arrays["in/qpos"].shape()[0], 14, 14]);
}
