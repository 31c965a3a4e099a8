//! Files that hold meshes: OBJ, STL, and MuJoCo's own MSH. Positions are single precision, as MuJoCo reads them.

use std::io::Cursor;

use glam::{DVec3, Vec3};

use super::{MOST, Triangles};

/// The format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Obj,
    Stl,
    Msh,
}

/// File name extensions, and content types.
pub(crate) const FORMATS: &[(&str, Format)] = &[
    ("obj", Format::Obj),
    ("stl", Format::Stl),
    ("msh", Format::Msh),
    ("model/obj", Format::Obj),
    ("model/stl", Format::Stl),
    ("model/vnd.mujoco.msh", Format::Msh),
];

impl Format {
    /// Reads a mesh; the error says what is wrong with the file.
    pub fn read(self, bytes: &[u8]) -> Result<Triangles, String> {
        match self {
            Format::Obj => obj(bytes),
            Format::Stl => stl(bytes),
            Format::Msh => msh(bytes),
        }
    }
}

fn position(p: Vec3) -> DVec3 {
    p.as_dvec3()
}

fn obj(bytes: &[u8]) -> Result<Triangles, String> {
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    // Materials are not read.
    let materials = |_: &std::path::Path| Ok(Default::default());
    let (objects, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, materials)
        .map_err(|error| format!("is not an OBJ file: {error}"))?;
    let mut mesh = Triangles::default();
    for tobj::Model { mesh: object, .. } in objects {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(object.positions.chunks_exact(3).map(|p| position(Vec3::from_slice(p))));
        mesh.faces.extend(object.indices.chunks_exact(3).map(|f| [f[0] + first, f[1] + first, f[2] + first]));
    }
    if mesh.vertices.is_empty() {
        // Vertices without faces belong to no object.
        mesh.vertices = loose(bytes)?;
    }
    Ok(mesh)
}

/// The vertices of an OBJ file without faces.
fn loose(bytes: &[u8]) -> Result<Vec<DVec3>, String> {
    let text = String::from_utf8_lossy(bytes);
    let vertices = text.lines().filter_map(|line| line.trim_start().strip_prefix("v "));
    let read = |line: &str| {
        let numbers: Vec<f32> = line.split_ascii_whitespace().take(3).filter_map(|word| word.parse().ok()).collect();
        let [x, y, z] = numbers[..] else { return Err(format!("is not an OBJ file: vertex \"{}\"", line.trim())) };
        Ok(position(Vec3::new(x, y, z)))
    };
    vertices.map(read).collect()
}

/// Length of the header of a binary STL file, of its number of triangles after that, and of a triangle.
const STL: [usize; 3] = [80, 4, 50];

fn stl(bytes: &[u8]) -> Result<Triangles, String> {
    let [header, number, triangle] = STL;
    let count = bytes.get(header..header + number).map(|n| u32::from_le_bytes([n[0], n[1], n[2], n[3]]) as usize);
    // Some binary files begin with the word by which text is told.
    let binary = count.is_some_and(|count| bytes.len() == header + number + triangle * count);
    if !binary && !bytes.starts_with(b"solid") {
        let held = bytes.len().saturating_sub(header + number) / triangle;
        return Err(match count {
            Some(count) => format!("is not an STL file: {count} triangles are announced, and there is room for {held}"),
            None => "is not an STL file: it ends within the header".into(),
        });
    }
    // The reader takes such a file for text: its header says nothing that matters.
    let mut plain = std::borrow::Cow::Borrowed(bytes);
    if binary && bytes.starts_with(b"solid") {
        plain.to_mut()[..header].fill(0);
    }
    let read = stl_io::read_stl(&mut Cursor::new(&*plain)).map_err(|error| format!("is not an STL file: {error}"))?;
    let face = |face: &stl_io::IndexedTriangle| face.vertices.map(|vertex| vertex as u32);
    if read.faces.len() > MOST {
        return Err(format!("has more than {MOST} triangles"));
    }
    Ok(Triangles {
        vertices: read.vertices.iter().map(|v| position(Vec3::new(v[0], v[1], v[2]))).collect(),
        faces: read.faces.iter().map(face).collect(),
    })
}

/// MSH: the numbers of vertices, normals, texture coordinates and triangles, then these, all little-endian and 32 bits wide.
fn msh(bytes: &[u8]) -> Result<Triangles, String> {
    let mut words = bytes.chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]]);
    let mut count = || words.next().map(i32::from_le_bytes).and_then(|n| usize::try_from(n).ok());
    let (Some(vertices), Some(normals), Some(coordinates), Some(faces)) = (count(), count(), count(), count()) else {
        return Err("is not an MSH file: it ends within the header, or a count in it is negative".into());
    };
    let sizes = [3, 3, 2, 3].into_iter().zip([vertices, normals, coordinates, faces]);
    let wanted = sizes.map(|(width, count)| width * count * 4).fold(16_usize, usize::saturating_add);
    if wanted != bytes.len() {
        return Err(format!("is not an MSH file: {wanted} bytes are announced, and there are {}", bytes.len()));
    }
    let numbers: Vec<f32> = words.by_ref().take(3 * vertices).map(f32::from_le_bytes).collect();
    let mut face = words.skip(3 * normals + 2 * coordinates).map(u32::from_le_bytes);
    let mut mesh = Triangles {
        vertices: numbers.chunks_exact(3).map(|p| position(Vec3::from_slice(p))).collect(),
        faces: Vec::with_capacity(faces),
    };
    while let (Some(a), Some(b), Some(c)) = (face.next(), face.next(), face.next()) {
        mesh.faces.push([a, b, c]);
    }
    Ok(mesh)
}
