//! Inverse weights of models in which tendons have armature: these couple dofs as links do not, so that the inertia matrix is formed and
//! factored.

use glam::DVec3;
use lanesim_kernels::inertia::{self, Inertia};
use lanesim_kernels::math::ldl;
use lanesim_kernels::model::{Instance, Model, NONE};
use lanesim_kernels::position::{self, Position};
use lanesim_kernels::tendon::{self, Tendons};

/// The factor of the inertia matrix in the reference configuration.
pub(super) struct Heavy {
    model: Model<f64>,
    position: Position<f64>,
    factor: Vec<f64>,
    inverse: Vec<f64>,
}

impl Heavy {
    /// That of a model, of which links, joints, dofs, tendons and the matrix's storage count; `None`: no tendon has armature.
    pub fn new(model: &Model<f64>) -> Option<Heavy> {
        if model.tendons.iter().all(|tendon| !tendon.heavy) {
            return None;
        }
        let sizes = &model.sizes;
        let (mut position, mut tendons) = (Position::new(sizes), Tendons::new(sizes));
        let mut inertia = Inertia::new(sizes);
        position::kinematics(Instance::from(model), (&model.qpos0[..]).into(), &mut position);
        tendon::tendons(model, &position, &model.qpos0, &vec![0.0; sizes.nv], &mut tendons);
        inertia::crb(Instance::from(model), &position, &tendons, &mut inertia);
        let (mut factor, mut inverse, mut scratch) = (inertia.m, vec![0.0; sizes.nv], vec![0.0; sizes.nv]);
        ldl::factor(&model.rows, &model.tree_pattern, &mut factor, &mut inverse, &mut scratch);
        Some(Heavy { model: model.clone(), position, factor, inverse })
    }

    /// Accelerations that a generalised force causes.
    pub fn response(&self, mut force: Vec<f64>) -> Vec<f64> {
        ldl::solve(&self.model.rows, &self.model.tree_pattern, &self.factor, &self.inverse, &mut force);
        force
    }

    /// Whether a tendon with armature acts on a dof.
    pub fn holds(&self, dof: usize) -> bool {
        let mut heavy = self.model.tendons.iter().filter(|tendon| tendon.heavy);
        heavy.any(|tendon| self.model.tendon_dofs[tendon.dofs.range()].iter().any(|entry| entry.dof as usize == dof))
    }

    /// Diagonal of the inverse.
    pub fn dofs(&self) -> Vec<f64> {
        let nv = self.model.sizes.nv;
        let unit = |i: usize| (0..nv).map(|k| f64::from(u8::from(k == i))).collect();
        (0..nv).map(|i| self.response(unit(i))[i]).collect()
    }

    /// Translational and rotational weight of a point of a link.
    pub fn body(&self, link: u32, point: [f64; 3]) -> [f64; 2] {
        let (position, l) = (&self.position, link as usize);
        let rot = glam::DMat3::from_cols_array(&position.rot[l]).transpose();
        let at = rot * DVec3::from(point) + DVec3::from(position.pos[l]);
        let mean = |row: &dyn Fn(&[f64; 6]) -> DVec3| {
            let axis = |k: usize| {
                let mut force = vec![0.0; self.model.sizes.nv];
                let mut dof = self.model.links[l].last_dof();
                while dof != NONE {
                    force[dof as usize] = row(&position.cdof[dof as usize])[k];
                    dof = self.model.dofs[dof as usize].parent;
                }
                let qacc = self.response(force.clone());
                force.iter().zip(qacc).map(|(f, a)| f * a).sum::<f64>()
            };
            ((axis(0) + axis(1) + axis(2)) / 3.0).max(0.0)
        };
        let turn = |cdof: &[f64; 6]| DVec3::from_slice(&cdof[..3]);
        let shift = |cdof: &[f64; 6]| DVec3::from_slice(&cdof[3..]) + turn(cdof).cross(at);
        [mean(&shift), mean(&turn)]
    }
}
