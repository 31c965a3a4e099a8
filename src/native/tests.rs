use wide::f64x8;

use lanesim_kernels::lane::LaneQuery;
use lanesim_kernels::pipeline::Run;
use lanesim_kernels::stage::Stages;
use lanesim_kernels::state::BlockStatus;
use lanesim_kernels::step::step;

use super::*;
use crate::convex::SupportCollider;
use crate::model::Model;

/// A block of worlds with what their steps need, at fixed addresses.
struct Bench {
    state: State<f64x8>,
    workspace: Workspace<f64x8>,
}

impl Bench {
    /// Positions after some steps from the reference configuration.
    fn run(&mut self, model: &Model, native: &mut Native<f64>, varied: Option<&Varied<f64x8>>) -> Vec<u64> {
        self.state.for_each(&mut |field| field.data.fill(f64x8::splat(0.0)));
        for (q, q0) in self.state.qpos.iter_mut().zip(&model.tables().qpos0) {
            *q = f64x8::splat(*q0);
        }
        let mut status = BlockStatus { alive: 0xff, ..BlockStatus::default() };
        for _ in 0..30 {
            let mut run = Run {
                applied: None,
                varied,
                clock: None,
                max_contacts: 100,
                convex: &SupportCollider,
                stages: Stages::STEP,
                residual: false,
                code: native,
                keep: false,
            };
            step(model.tables(), &mut self.state, &mut run, &mut status, &mut self.workspace);
        }
        assert_eq!(status.alive, 0xff);
        self.state.qpos.iter().map(|q| q.get(3).to_bits()).collect()
    }
}

/// Newton's iteration keeps its calls from step to step: not beyond the code that they call, in which masses were folded.
#[test]
fn code_that_is_swapped_leaves_no_calls_behind() {
    let text = "<mujoco><worldbody><geom type='plane' size='3 3 1'/><body pos='0 0 .1'><freejoint/>
        <geom type='box' size='.1 .1 .1'/></body></worldbody></mujoco>";
    let model = Model::from_xml_string(text, &Default::default()).expect("a model");
    let Ok(isa) = InstructionSet::detect() else { return };
    let Ok(code) = ModelCode::new(model.tables(), isa).map(Arc::new) else { return };
    let set = Quantities::of(&[Quantity::Link]);
    let mut varied = Varied::<f64x8>::new(model.tables(), set);
    varied.lanes_mut(Quantity::Link).iter_mut().for_each(|x| *x *= f64x8::splat(3.0));
    let bench = || Bench { state: State::new(&model.tables().sizes), workspace: Workspace::new(model.tables()) };

    let mut fresh = Native::new(code.clone());
    Code::<f64x8>::vary(&mut fresh, model.tables(), set);
    let expected = bench().run(&model, &mut fresh, Some(&varied));

    let (mut used, mut place) = (Native::new(code), bench());
    let light = place.run(&model, &mut used, None);
    Code::<f64x8>::vary(&mut used, model.tables(), set);
    assert_eq!(place.run(&model, &mut used, Some(&varied)), expected);
    assert_ne!(light, expected);
}

/// Code of a part that would not stay in the cache is not made, whatever part that is.
#[test]
fn no_part_is_recorded_at_any_size() {
    let body = "<body><freejoint/><geom size='.1' contype='0' conaffinity='0'/></body>";
    let text =
        format!("<mujoco><worldbody><replicate count='20000' offset='.3 0 0'>{body}</replicate></worldbody></mujoco>");
    let model = Model::from_xml_string(&text, &Default::default()).expect("a model");
    let Ok(isa) = InstructionSet::detect() else { return };
    let Ok(code) = ModelCode::new(model.tables(), isa) else { return };
    let start = std::time::Instant::now();
    assert!(code.parts().iter().all(|(_, code)| code.is_none()));
    // To record it all takes minutes; a machine with other work to do may take long for little, too.
    assert!(start.elapsed().as_secs() < 30);
}
