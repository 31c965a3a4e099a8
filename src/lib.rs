//! A data-oriented SIMD batch simulator for articulated bodies with contact.
//!
//! A [`Model`] is compiled once from MJCF, MuJoCo's model format, and shared read-only. [`Worlds`] is a batch of its states, all
//! of which go through the same steps: side by side in the lanes of the processor, and on all its cores. A world's numbers
//! never depend on what else is in the batch. [`Worlds::rollout`] takes controls in and gives trajectories out:
//!
//! ```
//! use lanesim::outputs::Output;
//! use lanesim::{Controls, Field, Model, Options, Rollout, Worlds};
//!
//! let pendulum = "<mujoco>
//!   <worldbody>
//!     <body>
//!       <joint name='pivot' axis='0 1 0' damping='0.1'/>
//!       <geom type='capsule' fromto='0 0 0 0 0 -1' size='0.05'/>
//!     </body>
//!   </worldbody>
//!   <actuator><motor joint='pivot' ctrlrange='-1 1'/></actuator>
//! </mujoco>";
//! let model = Model::from_xml_string(pendulum, &Default::default())?;
//!
//! // 64 pendulums, which start at different angles.
//! let mut worlds = Worlds::new(&model, 64, &Options::default())?;
//! for world in 0..worlds.nworld() {
//!     worlds.set(Field::Qpos, world, &[world as f64 * 0.05])?;
//! }
//!
//! // 100 steps with controls of each world's own, [nworld, nstep, nu]; angles come back, [nworld, nstep, nq].
//! let controls = vec![0.5; 64 * 100];
//! let outputs = [Output::named("qpos")?];
//! let rollout = Rollout { nstep: 100, controls: Controls::Given(&controls), outputs: &outputs, ..Rollout::default() };
//! let trajectories = worlds.rollout(&rollout)?;
//! assert_eq!(trajectories.outputs[0].len(), 64 * 100);
//!
//! // A world that diverges is frozen and flagged; the others do not notice.
//! assert_eq!(worlds.lost(), 0);
//! # Ok::<(), lanesim::Error>(())
//! ```
//!
//! | to | see |
//! |---|---|
//! | read a model, and learn what is in it | [`Model`], [`mjcf`], [`Spec`] |
//! | choose precision, backend, threads, and what becomes of worlds that diverge | [`Options`] |
//! | read and write states | [`Field`], [`Worlds::get_all`], [`Worlds::write_all`] |
//! | give worlds masses, gains or friction of their own | [`Parameter`], [`Worlds::set_parameter`] |
//! | record what steps compute, by MuJoCo's names | [`outputs`] |
//! | evaluate many states once | [`mod@eval`] |
//! | take derivatives of steps, of accelerations, of inverse dynamics | [`cloud`] |
//! | search the controls of an optimal motion | [`mod@optimise`] |

mod batch;
mod block;
pub mod cloud;
mod columns;
pub mod compile;
pub mod convex;
pub mod diagnostics;
pub mod error;
pub mod eval;
mod field;
mod group;
pub mod inverse;
pub mod memory;
mod mesh;
pub mod mjcf;
pub mod model;
mod native;
pub mod noise;
pub mod npz;
pub mod optimise;
mod options;
pub mod outputs;
mod pace;
mod parameters;
pub mod plan;
pub mod pool;
pub mod rollout;
pub mod rows;
pub mod spec;
mod states;
pub mod status;
mod store;
mod subset;
pub mod suggest;
mod unbuilt;
pub mod worlds;

pub use compile::compile;
pub use diagnostics::{Diagnostic, Diagnostics};
pub use error::Error;
pub use field::Field;
pub use model::Model;
pub use outputs::Reading;
pub use parameters::Parameter;
pub use plan::Plan;
pub use rollout::{Controls, Rollout, Trajectories};
pub use spec::Spec;
pub use status::{OnDiverge, StatusEvent};
pub use worlds::{Backend, CodePart, Options, Precision, Running, Worlds};

pub use lanesim_codegen::{InstructionSet, Statistics as CodeStatistics, prepare as prepare_to_fork};

/// The Rust in the README is tested as documentation is.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
