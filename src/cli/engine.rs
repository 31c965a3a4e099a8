//! The commands' view of the simulator.

use std::path::Path;
use std::sync::Arc;

use lanesim::npz::Array;

use super::failure::Failure;
use super::{ModelArgs, Precision, RunArgs};

pub struct Loaded {
    pub model: Arc<Model>,
    pub losses: Vec<String>,
    pub notes: Vec<String>,
    pub seconds: f64,
}

pub struct Model;

pub struct Key {
    pub time: f64,
    pub qpos: Vec<f64>,
    pub qvel: Vec<f64>,
    pub ctrl: Vec<f64>,
}

pub enum Controls<'a> {
    Hold,
    Given(&'a [f64]),
    Noise { seed: u64 },
}

pub struct Stats {
    pub ncon_mean: f64,
    pub nefc_mean: f64,
    pub solver_niter_mean: f64,
    pub solver_niter_block_max_mean: f64,
    pub slot_occupancy: f64,
    pub stages: Vec<(String, f64)>,
}

pub struct Done {
    pub outputs: Vec<Array>,
    pub stats: Stats,
}

pub struct Setup {
    pub precision: Precision,
    pub backend: super::Backend,
    pub threads: Option<u32>,
}

impl Model {
    pub fn name(&self) -> &str { todo!() }
    pub fn size(&self, _name: &str) -> usize { todo!() }
    pub fn sizes(&self) -> Vec<(&'static str, usize)> { todo!() }
    pub fn options(&self) -> &lanesim_kernels::options::Options { todo!() }
    pub fn array(&self, _name: &str) -> Option<Array> { todo!() }
    pub fn key(&self, _index: usize) -> Option<Key> { todo!() }
    pub fn accurate(&self) -> Arc<Model> { todo!() }
}

pub struct Batch;

impl Batch {
    pub fn new(_m: &Arc<Model>, _n: usize, _s: &Setup) -> Result<Batch, Failure> { todo!() }
    pub fn set(&mut self, _field: &str, _world: usize, _v: &[f64]) -> Result<(), Failure> { todo!() }
    pub fn get(&self, _field: &str, _world: usize) -> Vec<f64> { todo!() }
    pub fn run(&mut self, _steps: usize, _c: Controls, _outputs: &[String], _p: &(dyn Fn(u64) + Sync)) -> Result<Done, Failure> { todo!() }
    pub fn forward(&mut self, _fields: &[String]) -> Result<Vec<Array>, Failure> { todo!() }
    pub fn flags(&self, _world: usize) -> Vec<&'static str> { todo!() }
    pub fn lost(&self, _world: usize) -> bool { todo!() }
    pub fn threads(&self) -> usize { todo!() }
    pub fn lanes(&self) -> usize { todo!() }
    pub fn bytes_per_world(&self) -> usize { todo!() }
}
pub fn load(_a: &ModelArgs) -> Result<Loaded, Failure> { let _ = Path::new(""); todo!() }
impl From<&RunArgs> for Setup { fn from(r: &RunArgs) -> Setup { Setup { precision: r.precision, backend: r.backend, threads: r.threads } } }
