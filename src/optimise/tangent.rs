//! How differences of positions follow the positions: the derivative of the logarithm of rotations.

use faer::Mat;
use lanesim_kernels::model::JointKind;

use crate::model::Model;

/// The first dofs of the rotations that a model has.
fn rotations(model: &Model) -> impl Iterator<Item = usize> {
    model.tables().joints.iter().filter_map(|joint| match joint.kind {
        JointKind::Free => Some(joint.dof as usize + 3),
        JointKind::Ball => Some(joint.dof as usize),
        JointKind::Slide | JointKind::Hinge => None,
    })
}

/// For a difference of positions, `to` ⊖ `from`, its derivative by `to` in the tangent space there, `[nv, nv]`. That of the opposite difference
/// is the negative of the derivative by `from`.
pub(super) fn slopes(model: &Model, difference: &[f64]) -> Mat<f64> {
    let nv = difference.len();
    let mut out = Mat::identity(nv, nv);
    for at in rotations(model) {
        let block = log_slope([difference[at], difference[at + 1], difference[at + 2]]);
        for (i, row) in block.iter().enumerate() {
            for (k, x) in row.iter().enumerate() {
                out[(at + i, at + k)] = *x;
            }
        }
    }
    out
}

/// Where a rotation is exp(u), the derivative of log(exp(u) exp(ε)) by ε: 1 + [u]/2 + c [u]².
fn log_slope(u: [f64; 3]) -> [[f64; 3]; 3] {
    let squared: f64 = u.iter().map(|x| x * x).sum();
    let angle = squared.sqrt();
    let c = if angle < 1e-3 {
        1.0 / 12.0 + squared / 720.0
    } else {
        // At a full turn there is no derivative: differences are the shortest, at most half a turn.
        (1.0 - 0.5 * angle / (0.5 * angle).tan()) / squared
    };
    let cross = [[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]];
    let entry = |i: usize, k: usize| {
        let unit = if i == k { 1.0 } else { 0.0 };
        // [u]² = u uᵀ − u·u.
        unit + 0.5 * cross[i][k] + c * (u[i] * u[k] - squared * unit)
    };
    std::array::from_fn(|i| std::array::from_fn(|k| entry(i, k)))
}

#[cfg(test)]
mod tests {
    use lanesim_kernels::integration::{difference, displace};

    use super::*;

    /// Against differences of the kernels' own, to both sides.
    #[test]
    fn slopes_are_those_of_differences() {
        let xml = "<mujoco><worldbody><body><freejoint/><geom size='1'/><body><joint type='ball'/><geom size='1'/>
            <body><joint/><geom size='1'/></body></body></body></worldbody></mujoco>";
        let model = Model::from_xml_string(xml, &Default::default()).expect("a model");
        let (tables, nv) = (model.tables(), 10);
        for scale in [1e-5, 0.1, 1.0] {
            let step: Vec<f64> = (0..nv).map(|i| scale * (1.0 + (i as f64 * 1.7).sin())).collect();
            let (from, mut to, mut apart) = (&tables.qpos0, tables.qpos0.clone(), vec![0.0; nv]);
            displace(tables, from, &step, &mut to);
            difference(tables, from, &to, &mut apart);
            let (forth, back) = (slopes(&model, &apart), slopes(&model, &apart.iter().map(|x| -x).collect::<Vec<_>>()));
            for k in 0..nv {
                let moved = |start: &[f64], eps: f64| {
                    let (mut step, mut out) = (vec![0.0; nv], start.to_vec());
                    step[k] = eps;
                    displace(tables, start, &step, &mut out);
                    out
                };
                let slope = |side: &dyn Fn(f64) -> [Vec<f64>; 2], i: usize| {
                    let mut found = [vec![0.0; nv], vec![0.0; nv]];
                    for (found, eps) in found.iter_mut().zip([1e-5, -1e-5]) {
                        let [from, to] = side(eps);
                        difference(tables, &from, &to, found);
                    }
                    (found[0][i] - found[1][i]) / 2e-5
                };
                for i in 0..nv {
                    let by_to = slope(&|eps| [from.clone(), moved(&to, eps)], i);
                    let by_from = slope(&|eps| [moved(from, eps), to.clone()], i);
                    assert!((forth[(i, k)] - by_to).abs() < 1e-8, "{scale} {i} {k}: {} {by_to}", forth[(i, k)]);
                    assert!((back[(i, k)] + by_from).abs() < 1e-8, "{scale} {i} {k}: {} {by_from}", back[(i, k)]);
                }
            }
        }
    }
}
