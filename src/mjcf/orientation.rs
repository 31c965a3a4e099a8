//! The notations of an orientation, and poses of frames.

/// An orientation as it was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Orientation {
    /// (w, x, y, z), any length.
    Quat([f64; 4]),
    /// Axis and angle.
    AxisAngle([f64; 4]),
    /// Three angles, in the order of `compiler/eulerseq`.
    Euler([f64; 3]),
    /// Where the z axis points: the shortest rotation.
    ZAxis([f64; 3]),
    /// The x axis and, once made orthogonal to it, the y axis.
    XyAxes([f64; 6]),
}

/// How angles are written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Angles {
    /// Radians per unit.
    pub scale: f64,
    /// The axes of `euler`: lower case moves with the rotations, upper case stays.
    pub sequence: [u8; 3],
}

/// Axes shorter than this have no direction (MuJoCo's bound).
const SHORTEST: f64 = 1e-14;

impl Orientation {
    /// No rotation.
    pub const IDENTITY: Orientation = Orientation::Quat([1.0, 0.0, 0.0, 0.0]);

    /// The unit quaternion, or what is wrong.
    pub fn quat(&self, angles: &Angles) -> Result<[f64; 4], &'static str> {
        match *self {
            Orientation::Quat(q) => normalized(q).ok_or("zero quaternion"),
            Orientation::AxisAngle([x, y, z, angle]) => {
                let axis = unit([x, y, z]).ok_or("axisangle: the axis is too short")?;
                Ok(about(axis, angle * angles.scale))
            }
            Orientation::Euler(e) => Ok(euler(e, angles)),
            Orientation::ZAxis(z) => from_z(z).ok_or("zaxis is too short"),
            Orientation::XyAxes([a, b, c, d, e, f]) => from_xy([a, b, c], [d, e, f]),
        }
    }
}

/// A quaternion of length 1; nothing if its length is 0.
fn normalized(q: [f64; 4]) -> Option<[f64; 4]> {
    // Scaling first keeps squares of huge or tiny components finite.
    let largest = q.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let scaled = q.map(|x| x / largest);
    let norm = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !norm.is_finite() || largest * norm < SHORTEST {
        return None;
    }
    // A quaternion of length 1 keeps its bits.
    if (largest * norm - 1.0).abs() <= 1e-15 { Some(q) } else { Some(scaled.map(|x| x / norm)) }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The direction of a vector, if it has one.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let scaled = v.map(|x| x / largest);
    let norm = dot(scaled, scaled).sqrt();
    (norm.is_finite() && largest * norm >= SHORTEST).then(|| scaled.map(|x| x / norm))
}

/// Rotation by an angle about a unit axis.
fn about(axis: [f64; 3], angle: f64) -> [f64; 4] {
    let (s, c) = (0.5 * angle).sin_cos();
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

fn euler(e: [f64; 3], angles: &Angles) -> [f64; 4] {
    let mut q = [1.0, 0.0, 0.0, 0.0];
    for (letter, angle) in angles.sequence.iter().zip(e) {
        let mut axis = [0.0; 3];
        axis[usize::from(letter.to_ascii_lowercase().saturating_sub(b'x')).min(2)] = 1.0;
        let turn = about(axis, angle * angles.scale);
        q = if letter.is_ascii_lowercase() { mul(q, turn) } else { mul(turn, q) };
    }
    q
}

/// The shortest rotation that takes the z axis to a direction; for the opposite direction a half turn about x.
pub(super) fn from_z(z: [f64; 3]) -> Option<[f64; 4]> {
    let z = unit(z)?;
    let axis = cross([0.0, 0.0, 1.0], z);
    let sine = dot(axis, axis).sqrt();
    if sine < 1e-10 {
        return Some(if z[2] > 0.0 { [1.0, 0.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0, 0.0] });
    }
    Some(about(axis.map(|x| x / sine), sine.atan2(z[2])))
}

fn from_xy(x: [f64; 3], y: [f64; 3]) -> Result<[f64; 4], &'static str> {
    let x = unit(x).ok_or("xyaxes: the x axis is too short")?;
    let along = dot(x, y);
    let y = unit([y[0] - along * x[0], y[1] - along * x[1], y[2] - along * x[2]])
        .ok_or("xyaxes: the y axis is too short or parallel to the x axis")?;
    Ok(from_columns(x, y, cross(x, y)))
}

/// The quaternion of a rotation matrix given by its columns, from its largest component.
fn from_columns(x: [f64; 3], y: [f64; 3], z: [f64; 3]) -> [f64; 4] {
    let fours = [x[0] + y[1] + z[2], x[0] - y[1] - z[2], y[1] - x[0] - z[2], z[2] - x[0] - y[1]];
    let mut largest = 0;
    for i in 1..4 {
        if fours[i] > fours[largest] {
            largest = i;
        }
    }
    let c = 0.5 * (1.0 + fours[largest]).max(0.0).sqrt();
    let (a, b, d) = (y[2] - z[1], z[0] - x[2], x[1] - y[0]);
    let (e, f, g) = (y[0] + x[1], z[0] + x[2], z[1] + y[2]);
    let k = 0.25 / c;
    match largest {
        0 => [c, k * a, k * b, k * d],
        1 => [k * a, c, k * e, k * f],
        2 => [k * b, k * e, c, k * g],
        _ => [k * d, k * f, k * g, c],
    }
}

/// The product of two quaternions: first `b`, then `a`.
pub(super) fn mul(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Turns a vector.
pub(super) fn rotate(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let u = [q[1], q[2], q[3]];
    let t = cross(u, v).map(|x| 2.0 * x);
    let c = cross(u, t);
    [v[0] + q[0] * t[0] + c[0], v[1] + q[0] * t[1] + c[1], v[2] + q[0] * t[2] + c[2]]
}

/// A position and an orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    pub pos: [f64; 3],
    pub quat: [f64; 4],
}

impl Pose {
    /// No motion.
    pub const IDENTITY: Pose = Pose { pos: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0] };

    /// A pose inside this one, seen from outside. A pose that changes nothing keeps the bits of the other.
    pub fn then(&self, inner: &Pose) -> Pose {
        if *self == Pose::IDENTITY {
            return *inner;
        }
        let turned = rotate(self.quat, inner.pos);
        let pos = [self.pos[0] + turned[0], self.pos[1] + turned[1], self.pos[2] + turned[2]];
        let quat = mul(self.quat, inner.quat);
        Pose { pos, quat: normalized(quat).unwrap_or(quat) }
    }
}
