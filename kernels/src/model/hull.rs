//! Convex hulls of meshes.

/// A convex polyhedron about the origin of its geom. Colliders see it in double precision, whatever the worlds have.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Corners.
    pub vertices: Vec<[f64; 3]>,
    /// Faces.
    pub faces: Vec<HullFace>,
    /// Neighbours of vertex v: those from `starts[v]` to `starts[v + 1]`.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
    /// Of every vertex the faces that meet there, likewise.
    face_starts: Vec<u32>,
    faces_at: Vec<u32>,
    /// The farthest vertices along directions all around, by [`cell`], from which a search starts; none if there are few.
    seeds: Vec<u32>,
}

/// A flat face.
#[derive(Clone, Debug, PartialEq)]
pub struct HullFace {
    /// Unit normal, outward.
    pub normal: [f64; 3],
    /// Vertices, one after the other around it.
    pub corners: Vec<u32>,
}

/// Hulls of so few vertices are searched through.
const FEW: usize = 24;
/// Cells along an edge of the cube of directions.
const CELLS: usize = 4;

/// The cell of a direction on the surface of a cube.
fn cell(direction: [f64; 3]) -> usize {
    let [x, y, z] = direction.map(f64::abs);
    let (axis, most) = if x >= y && x >= z {
        (0, x)
    } else if y >= z {
        (1, y)
    } else {
        (2, z)
    };
    let half = 0.5 * CELLS as f64;
    let along = |axis: usize| ((half + half * direction[axis % 3] / most) as usize).min(CELLS - 1);
    let side = 2 * axis + usize::from(direction[axis] < 0.0);
    (side * CELLS + along(axis + 1)) * CELLS + along(axis + 2)
}

/// The direction of a cell's middle.
fn middle(cell: usize) -> [f64; 3] {
    let (side, along) = (cell / (CELLS * CELLS), [cell / CELLS % CELLS, cell % CELLS]);
    let (axis, mut out) = (side / 2, [0.0; 3]);
    out[axis] = if side % 2 == 0 { 1.0 } else { -1.0 };
    for (k, along) in (1..).zip(along) {
        out[(axis + k) % 3] = (2.0 * along as f64 + 1.0) / CELLS as f64 - 1.0;
    }
    out
}

impl Hull {
    /// A hull from its corners, the neighbours of each, and its faces.
    pub fn new(vertices: Vec<[f64; 3]>, neighbours: &[Vec<u32>], faces: Vec<HullFace>) -> Hull {
        let mut at: Vec<Vec<u32>> = vec![Vec::new(); vertices.len()];
        for (f, face) in (0..).zip(&faces) {
            face.corners.iter().for_each(|corner| at[*corner as usize].push(f));
        }
        let ([starts, face_starts], [neighbours, faces_at]) = {
            let (a, b) = (packed(neighbours), packed(&at));
            ([a.0, b.0], [a.1, b.1])
        };
        let mut hull = Hull { vertices, faces, starts, neighbours, face_starts, faces_at, seeds: Vec::new() };
        if hull.vertices.len() > FEW {
            hull.seeds = (0..6 * CELLS * CELLS).map(|cell| hull.searched(middle(cell))).collect();
        }
        hull
    }

    /// Neighbours of a vertex.
    pub fn neighbours(&self, vertex: u32) -> &[u32] {
        &self.neighbours[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize]
    }

    /// The faces that meet at a vertex.
    pub fn faces_at(&self, vertex: u32) -> impl Iterator<Item = &HullFace> {
        let range = self.face_starts[vertex as usize] as usize..self.face_starts[vertex as usize + 1] as usize;
        self.faces_at[range].iter().map(|face| &self.faces[*face as usize])
    }

    /// A vertex than which none is farther along a direction.
    pub fn support(&self, direction: [f64; 3]) -> u32 {
        if self.vertices.len() <= FEW {
            return self.searched(direction);
        }
        let height = |vertex: u32| dot(&self.vertices[vertex as usize], &direction);
        let better = |best: u32, next: &u32| if height(*next) > height(best) { *next } else { best };
        let mut at = self.seeds[cell(direction)];
        loop {
            let next = self.neighbours(at).iter().fold(at, better);
            if next == at {
                return at;
            }
            at = next;
        }
    }

    /// The same, by looking at all.
    fn searched(&self, direction: [f64; 3]) -> u32 {
        let (mut best, mut most) = (0, f64::NEG_INFINITY);
        for (v, vertex) in (0..).zip(&self.vertices) {
            let height = dot(vertex, &direction);
            if height > most {
                (best, most) = (v, height);
            }
        }
        best
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Lists one after the other, and where each starts.
fn packed(lists: &[Vec<u32>]) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0];
    for list in lists {
        starts.push(starts.last().copied().unwrap_or(0) + list.len() as u32);
    }
    (starts, lists.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_in_the_cell_of_their_middle() {
        for c in 0..6 * CELLS * CELLS {
            assert_eq!(cell(middle(c)), c);
        }
        // Edges and corners of the cube, and no direction at all, have some cell.
        for direction in [[1.0, 1.0, 1.0], [-1.0, -1.0, 0.0], [0.0, 0.0, 0.0], [f64::NAN; 3]] {
            assert!(cell(direction) < 6 * CELLS * CELLS);
        }
    }
}
