//! Three-vectors `[L; 3]` and row-major 3×3 matrices `[L; 9]`.

use crate::lane::Lane;

/// A vector.
pub type Vec3<L> = [L; 3];
/// A matrix, row-major.
pub type Mat3<L> = [L; 9];

/// The array of `f(0)`, `f(1)`, ... A loop, because `std::array::from_fn` is not always inlined for entries as large as
/// lanes.
#[inline(always)]
pub fn build<L: Lane, const N: usize>(mut f: impl FnMut(usize) -> L) -> [L; N] {
    let mut out = [L::zero(); N];
    for (i, out) in out.iter_mut().enumerate() {
        *out = f(i);
    }
    out
}

/// The same model vector in every lane.
#[inline(always)]
pub fn splat<L: Lane, const N: usize>(a: &[L::Real; N]) -> [L; N] {
    build(|i| L::splat(a[i]))
}

/// Zero vector.
#[inline(always)]
pub fn zero<L: Lane, const N: usize>() -> [L; N] {
    [L::zero(); N]
}

/// a + b
#[inline(always)]
pub fn add<L: Lane, const N: usize>(a: &[L; N], b: &[L; N]) -> [L; N] {
    build(|i| a[i] + b[i])
}

/// a - b
#[inline(always)]
pub fn sub<L: Lane, const N: usize>(a: &[L; N], b: &[L; N]) -> [L; N] {
    build(|i| a[i] - b[i])
}

/// s a
#[inline(always)]
pub fn scale<L: Lane, const N: usize>(s: L, a: &[L; N]) -> [L; N] {
    build(|i| s * a[i])
}

/// s a + b
#[inline(always)]
pub fn scale_add<L: Lane, const N: usize>(s: L, a: &[L; N], b: &[L; N]) -> [L; N] {
    build(|i| s.mul_add(a[i], b[i]))
}

/// -a
#[inline(always)]
pub fn neg<L: Lane, const N: usize>(a: &[L; N]) -> [L; N] {
    build(|i| -a[i])
}

/// `a` where the mask holds, else `b`.
#[inline(always)]
pub fn select<L: Lane, const N: usize>(mask: L::Mask, a: &[L; N], b: &[L; N]) -> [L; N] {
    build(|i| L::select(mask, a[i], b[i]))
}

/// a · b
#[inline(always)]
pub fn dot<L: Lane>(a: &Vec3<L>, b: &Vec3<L>) -> L {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// a · b + c
#[inline(always)]
pub fn dot_add<L: Lane>(a: &Vec3<L>, b: &Vec3<L>, c: L) -> L {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0].mul_add(b[0], c)))
}

/// a × b
#[inline(always)]
pub fn cross<L: Lane>(a: &Vec3<L>, b: &Vec3<L>) -> Vec3<L> {
    [a[2].neg_mul_add(b[1], a[1] * b[2]), a[0].neg_mul_add(b[2], a[2] * b[0]), a[1].neg_mul_add(b[0], a[0] * b[1])]
}

/// a × b + c
#[inline(always)]
pub fn cross_add<L: Lane>(a: &Vec3<L>, b: &Vec3<L>, c: &Vec3<L>) -> Vec3<L> {
    [
        a[2].neg_mul_add(b[1], a[1].mul_add(b[2], c[0])),
        a[0].neg_mul_add(b[2], a[2].mul_add(b[0], c[1])),
        a[1].neg_mul_add(b[0], a[0].mul_add(b[1], c[2])),
    ]
}

/// ‖a‖
#[inline(always)]
pub fn norm<L: Lane>(a: &Vec3<L>) -> L {
    dot(a, a).sqrt()
}

/// a / ‖a‖ and ‖a‖; (1, 0, 0) for vectors shorter than `MINVAL`.
#[inline(always)]
pub fn normalize<L: Lane>(a: &Vec3<L>) -> (Vec3<L>, L) {
    use crate::lane::Real;
    let length = norm(a);
    let short = length.lt(L::of(L::Real::MINVAL));
    let inverse = L::one() / L::select(short, L::one(), length);
    let unit = [L::one(), L::zero(), L::zero()];
    (select(short, &unit, &scale(inverse, a)), length)
}

/// m a
#[inline(always)]
pub fn mul<L: Lane>(m: &Mat3<L>, a: &Vec3<L>) -> Vec3<L> {
    build(|i| m[3 * i + 2].mul_add(a[2], m[3 * i + 1].mul_add(a[1], m[3 * i] * a[0])))
}

/// m a + b
#[inline(always)]
pub fn mul_add<L: Lane>(m: &Mat3<L>, a: &Vec3<L>, b: &Vec3<L>) -> Vec3<L> {
    build(|i| m[3 * i + 2].mul_add(a[2], m[3 * i + 1].mul_add(a[1], m[3 * i].mul_add(a[0], b[i]))))
}

/// mᵀ a
#[inline(always)]
pub fn mul_t<L: Lane>(m: &Mat3<L>, a: &Vec3<L>) -> Vec3<L> {
    build(|i| m[6 + i].mul_add(a[2], m[3 + i].mul_add(a[1], m[i] * a[0])))
}

/// a b
#[inline(always)]
pub fn mul_mat<L: Lane>(a: &Mat3<L>, b: &Mat3<L>) -> Mat3<L> {
    build(|k| {
        let (i, j) = (k / 3, k % 3);
        a[3 * i + 2].mul_add(b[6 + j], a[3 * i + 1].mul_add(b[3 + j], a[3 * i] * b[j]))
    })
}

/// Column j of m.
#[inline(always)]
pub fn column<L: Lane>(m: &Mat3<L>, j: usize) -> Vec3<L> {
    [m[j], m[3 + j], m[6 + j]]
}

/// Row i of m.
#[inline(always)]
pub fn row<L: Lane>(m: &Mat3<L>, i: usize) -> Vec3<L> {
    [m[3 * i], m[3 * i + 1], m[3 * i + 2]]
}

/// m times the rotation about coordinate axis `axis` with the given sine and cosine: mixes two columns.
#[inline(always)]
pub fn rotate_columns<L: Lane>(m: &mut Mat3<L>, axis: u8, sin: L, cos: L) {
    let (a, b) = match axis {
        0 => (1, 2),
        1 => (2, 0),
        _ => (0, 1),
    };
    for i in [0, 3, 6] {
        let (x, y) = (m[i + a], m[i + b]);
        m[i + a] = x.mul_add(cos, y * sin);
        m[i + b] = x.neg_mul_add(sin, y * cos);
    }
}

/// The rotation about a unit axis (Rodrigues' formula).
#[inline(always)]
pub fn rotation<L: Lane>(axis: &Vec3<L>, sin: L, cos: L) -> Mat3<L> {
    let [x, y, z] = *axis;
    let one_cos = L::one() - cos;
    let (xc, yc, zc) = (x * one_cos, y * one_cos, z * one_cos);
    let (xs, ys, zs) = (x * sin, y * sin, z * sin);
    [
        x.mul_add(xc, cos),
        x.mul_add(yc, -zs),
        x.mul_add(zc, ys),
        y.mul_add(xc, zs),
        y.mul_add(yc, cos),
        y.mul_add(zc, -xs),
        z.mul_add(xc, -ys),
        z.mul_add(yc, xs),
        z.mul_add(zc, cos),
    ]
}
