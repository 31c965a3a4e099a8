//! Random search over linear policies: every world runs a policy of its own, which sees the state before each step.
//!
//! `cargo run --release --example policy_search`

use lanesim::rows::{Strided, Values};
use lanesim::{Error, Field, Model, Options, Precision, Worlds};

const POLICIES: usize = 256;
const STEPS: usize = 300;

/// Numbers in [-1, 1), the same on every run.
fn uniform(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

fn main() -> Result<(), Error> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/models/zoo/cartpole.xml");
    let model = Model::from_xml_path(path.as_ref(), &Default::default())?;
    let options = Options { precision: Precision::F32, ..Options::default() };
    let mut worlds = Worlds::new(&model, POLICIES, &options)?;
    let (nq, nv, nu) = (Field::Qpos.len(&model), Field::Qvel.len(&model), Field::Ctrl.len(&model));
    let mut seed = 1;
    let mut best = (vec![0.0; nu * (nq + nv)], f64::INFINITY);
    for round in 0..5 {
        worlds.reset_all(None, None)?;
        worlds.write_all(Field::Qpos, &Strided::new(Values::F64(&[0.0, 0.2]), nq), None)?;
        let near = |seed: &mut u64| best.0.iter().map(|gain| gain + uniform(seed)).collect();
        let policies: Vec<Vec<f64>> = (0..POLICIES).map(|_| near(&mut seed)).collect();
        let mut costs = vec![0.0; POLICIES];
        for _ in 0..STEPS {
            let (qpos, qvel) = (worlds.get_all(Field::Qpos), worlds.get_all(Field::Qvel));
            let mut controls = Vec::with_capacity(POLICIES * nu);
            for (world, policy) in policies.iter().enumerate() {
                let seen = || qpos[world * nq..][..nq].iter().chain(&qvel[world * nv..][..nv]);
                let rows = policy.chunks_exact(nq + nv);
                controls.extend(rows.map(|gains| gains.iter().zip(seen()).map(|(k, x)| -k * x).sum::<f64>()));
                costs[world] += seen().map(|x| x * x).sum::<f64>();
            }
            worlds.write_all(Field::Ctrl, &Strided::new(Values::F64(&controls), nu), None)?;
            worlds.step(1)?;
        }
        for (policy, cost) in policies.into_iter().zip(costs) {
            if cost < best.1 {
                best = (policy, cost);
            }
        }
        println!("round {round}: cost {:.3}", best.1 / STEPS as f64);
    }
    Ok(())
}
