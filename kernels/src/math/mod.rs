//! Small algebra over lanes: vectors, rotations, quaternions, spatial vectors and the sparse factor.

pub mod ldl;
pub mod low;
pub mod lu;
pub mod quat;
pub mod spatial;
pub mod tree;
pub mod vec3;
