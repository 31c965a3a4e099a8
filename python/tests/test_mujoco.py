"""Models taken over from MuJoCo, and calls meant for it."""

from __future__ import annotations

import pathlib
import pickle
import warnings

import corpus
import lanesim
import mujoco
import numpy as np
import pytest
from conftest import MODELS, PENDULUM

TWO = """
<mujoco>{head}<worldbody>
  <body name="a" pos=".123456789012345 0 1"><joint name="j" damping=".123456789012345"/><geom name="g" size=".1"/><site name="s"/></body>
  <body name="b" pos="1 0 1"><joint name="k" type="ball"/><geom size=".1 .2" type="capsule"/></body>
</worldbody>{tail}</mujoco>
"""


def same(exact: mujoco.MjModel, model: lanesim.Model) -> None:
    """The arrays that both have, and a step."""
    for name in model.array_names:
        theirs = getattr(exact, name, getattr(exact.opt, name, None))
        if theirs is not None and not name.startswith("o_"):
            ours = getattr(model, name)
            np.testing.assert_allclose(ours, np.reshape(theirs, ours.shape), rtol=1e-9, atol=1e-15, err_msg=name)
    if model.opt.integrator != lanesim.Integrator.Euler:
        return
    corpus.settle(exact)
    model = model.replace(**corpus.OPTIONS)
    for data in corpus.states(exact, 2):
        row = np.empty(1 + exact.nq + exact.nv + exact.na)
        mujoco.mj_getState(exact, data, row, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
        state, _ = lanesim.rollout(model, row, data.ctrl[None] if exact.nu else None, nstep=1)
        mujoco.mj_step(exact, data)
        scale = 1e-6 * max(1.0, np.abs(data.qvel).max(initial=0.0))
        np.testing.assert_allclose(
            state[0, 0], np.concatenate([[data.time], data.qpos, data.qvel, data.act]), atol=scale
        )


STEPPED = ["ant", "cartpole", "closed_chain", "four_bar", "cheetah", "hand32", "hopper", "humanoid18", "humanoid27", "quadruped", "stewart", "walker"]


@pytest.mark.parametrize("name", STEPPED)
def test_an_mjmodel_is_taken_over_number_by_number(name) -> None:
    path = str(MODELS / "zoo" / f"{name}.xml")
    exact = mujoco.MjModel.from_xml_path(path)
    model = lanesim.Model.from_mjmodel(exact)
    assert (model.name, model.names("joint")) == (
        lanesim.Model.from_xml_path(path).name,
        [exact.joint(j).name for j in range(exact.njnt)],
    )
    same(exact, model)
    assert pickle.loads(pickle.dumps(model)).nq == exact.nq


@pytest.mark.parametrize("name", ["activation", "activation_group", "muscle", "actuator_refsite", "actuator_slidercrank"])
def test_actuators_are_stepped_as_by_mujoco(name) -> None:
    exact = mujoco.MjModel.from_xml_path(str(MODELS / "unit" / f"{name}.xml"))
    same(exact, lanesim.Model.from_mjmodel(exact))


def test_every_model_of_the_repository_is_taken_over() -> None:
    taken = 0
    for path in corpus.ours():
        exact = corpus.load_mujoco(path)
        if exact is None:
            continue
        try:
            lanesim.Model.from_xml_path(path)
        except lanesim.ModelError:
            continue
        if exact.nhfield:
            with pytest.raises(lanesim.ModelError, match="height fields"):
                lanesim.Model.from_mjmodel(exact)
            continue
        lanesim.Model.from_mjmodel(exact)  # Which compares all arrays.
        taken += 1
    assert taken > 100


def test_frames_of_symmetric_meshes_are_taken_over() -> None:
    """Of axes that are equal but for rounding, which comes first is MuJoCo's choice."""
    for scale in np.linspace(0.05, 0.2, 8):
        meshes = {"sphere": f"{scale} {1.2 * scale} {scale}", "hemisphere": f"{scale} {scale} {scale}"}
        assets = "".join(
            f"<mesh name='{kind}' builtin='{kind}' params='2' scale='{size}' refquat='.9 .1 .2 .3'/>" for kind, size in meshes.items()
        )
        bodies = "".join(f"<body><freejoint/><geom type='mesh' mesh='{kind}' euler='10 20 30'/></body>" for kind in meshes)
        exact = mujoco.MjModel.from_xml_string(
            f"<mujoco><asset>{assets}</asset><worldbody>{bodies}</worldbody></mujoco>"
        )
        model = lanesim.Model.from_mjmodel(exact)
        assert np.abs(model.geom_quat - exact.geom_quat).max() < 1e-15
        assert np.abs(model.geom_pos - exact.geom_pos).max() < 1e-15


def test_specs_lose_no_digits() -> None:
    spec = mujoco.MjSpec.from_string(
        TWO.format(head="", tail="<actuator><position joint='j' kp='3.00000000001'/></actuator>")
    )
    exact = spec.copy().compile()
    model = lanesim.Model.from_spec(spec)
    assert model.body_pos[1, 0] == 0.123456789012345 and model.dof_damping[0] == 0.123456789012345
    assert model.actuator_gainprm[0, 0] == 3.00000000001 and model.nu == 1
    same(exact, model)


def test_a_spec_built_in_code() -> None:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(pos=[0, 0, 1])
    body.add_joint(name="hinge", axis=[0, 1, 0])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], pos=[0.3, 0, 0])
    spec.add_actuator(name="push", target="hinge", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    same(spec.copy().compile(), lanesim.Model.from_spec(spec))
    spec.worldbody.add_body(name="hinge").add_joint()
    with pytest.raises(lanesim.ModelError, match="MuJoCo cannot compile the MjSpec: .*mass"):
        lanesim.Model.from_spec(spec)


def test_changes_after_loading_count() -> None:
    exact = mujoco.MjModel.from_xml_string(PENDULUM)
    exact.opt.timestep, exact.opt.gravity[2] = 0.0123, -1.0
    exact.dof_damping[0], exact.geom_friction[0, 0] = 0.7, 0.3
    exact.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model = lanesim.Model.from_mjmodel(exact, options={"iterations": 7})
    assert (model.opt.timestep, model.opt.gravity[2], model.dof_damping[0]) == (0.0123, -1.0, 0.7)
    assert model.geom_friction[0, 0] == 0.3 and model.opt.iterations == 7 and not model.opt.flags["contact"]
    for name, value in (("body_mass", 5.0), ("dof_armature", 1.0)):
        changed = mujoco.MjModel.from_xml_string(PENDULUM)
        getattr(changed, name)[-1] = value
        with pytest.raises(lanesim.ModelError, match="is .* and should be .*mj_setConst"):
            lanesim.Model.from_mjmodel(changed)
        mujoco.mj_setConst(changed, mujoco.MjData(changed))
        same(changed, lanesim.Model.from_mjmodel(changed))


@pytest.mark.parametrize(
    "head, tail, reason",
    [
        ("<option integrator='discrete'><flag ipc='enable'/></option>", "", "incremental potential contact"),
    ],
)
def test_what_is_not_supported_is_refused_with_the_reason(head, tail, reason) -> None:
    exact = mujoco.MjModel.from_xml_string(TWO.format(head=head, tail=tail))
    for take in (
        lanesim.Model.from_mjmodel,
        lambda exact: lanesim.Model.from_spec(mujoco.MjSpec.from_string(TWO.format(head=head, tail=tail))),
    ):
        with pytest.raises(lanesim.ModelError, match=reason):
            take(exact)


def lenient_loads(tmp_path: pathlib.Path):
    text = TWO.format(
        head="",
        tail="<worldbody><geom name='w' size='.1' adhesion='1'/><geom name='v' size='.1' adhesion='1'/></worldbody>",
    )
    (tmp_path / "two.xml").write_text(text)
    yield lambda: lanesim.Model.from_xml_string(text, lenient=True)
    yield lambda: lanesim.Model.from_xml_path(tmp_path / "two.xml", lenient=True)
    yield lambda: lanesim.Model.from_spec(mujoco.MjSpec.from_string(text), lenient=True)
    yield lambda: lanesim.Model.from_mjmodel(mujoco.MjModel.from_xml_string(text), lenient=True)


def test_losses_are_one_warning_and_in_the_report(tmp_path) -> None:
    for load in lenient_loads(tmp_path):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            model = load()
        (warning,) = caught
        assert issubclass(warning.category, lanesim.LossWarning) and issubclass(warning.category, UserWarning)
        assert warning.filename == __file__ and 'geom "w"' in str(warning.message)
        assert len(model.report().losses) == 2 and 'geom "v"' in model.report().losses[1]
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            pickle.loads(pickle.dumps(model))
            model.replace(timestep=0.001)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lanesim.Model.from_xml_string(PENDULUM, lenient=True)


def test_calls_meant_for_mujoco_rollout_say_what_to_leave_out(pendulum) -> None:
    exact = mujoco.MjModel.from_xml_string(PENDULUM)
    data, start, control = mujoco.MjData(exact), np.zeros(3), np.zeros((1, 4, 1))
    hint = r"becomes lanesim.rollout\(model, initial_state, control\); threads=N takes the place"
    pool = lanesim.Rollout(threads=1)
    for call in (lanesim.rollout, pool.rollout):
        for model in (pendulum, exact):
            with pytest.raises(TypeError, match="leave out the second argument, a list of MjData: .*" + hint):
                call(model, [data], start, control)
            with pytest.raises(TypeError, match="leave out the second argument, MjData: .*" + hint):
                call(model, data, start, control)
        with pytest.raises(TypeError, match="leave out the argument data: .*" + hint):
            call(pendulum, data=[data], initial_state=start, control=control)
        with pytest.raises(TypeError, match=r"model is a mujoco.MjModel; .*lanesim.Model.from_mjmodel\(model\) makes"):
            call(exact, start, control)
        with pytest.raises(TypeError, match="model is a list; lanesim.rollout takes one model per call"):
            call([exact, exact], start, control)
        with pytest.raises(TypeError, match="name the others, such as nstep=100"):
            call(pendulum, start, control, 5)
        with pytest.raises(TypeError, match='no argument "output"; did you mean "outputs"?'):
            call(pendulum, start, control, output=["qpos"])
        assert call(pendulum, start, control)[0].shape == (1, 4, 3)
    for model, remedy in ((exact, "from_mjmodel"), (mujoco.MjSpec(), "from_spec")):
        with pytest.raises(TypeError, match=remedy):
            lanesim.Worlds(model, 3)
    with pytest.raises(TypeError, match="from_mjmodel takes it"):
        lanesim.Model.from_spec(exact)
    with pytest.raises(TypeError, match="expected a mujoco.MjModel"):
        lanesim.Model.from_mjmodel(pendulum)


def test_one_spelling_per_option(pendulum) -> None:
    start = np.zeros(3)
    wanted, _ = lanesim.rollout(pendulum, start, nstep=4)
    for options in (
        {"threads": 1, "backend": "wide"},
        {"nthread": 2},
        {"threads": 2, "backend": "scalar", "persistent_pool": True},
    ):
        np.testing.assert_array_equal(lanesim.rollout(pendulum, start, nstep=4, **options)[0], wanted)
    lanesim.shutdown_persistent_pool()
    with lanesim.Rollout(threads=1, backend="wide") as pool:
        assert pool.threads == pool.nthread == 1
        np.testing.assert_array_equal(pool.rollout(pendulum, start, nstep=4)[0], wanted)
    with pytest.raises(lanesim.InputError, match="threads and nthread are the same"):
        lanesim.rollout(pendulum, start, threads=1, nthread=1)
    with pytest.raises(lanesim.InputError, match="threads is 0; expected at least 1"):
        lanesim.Rollout(threads=0)
    for call in (
        lanesim.Rollout,
        lambda **options: lanesim.rollout(pendulum, start, **options),
        lambda **options: lanesim.Worlds(pendulum, 2, **options),
    ):
        with pytest.raises(lanesim.UnknownNameError, match='backend is .natve.; .*did you mean "native"'):
            call(backend="natve")


@pytest.mark.parametrize(
    "call, text",
    [
        (lambda m: lanesim.Worlds(m, 1).get("qpoz"), 'there is no output qpoz; did you mean "qpos"'),
        (lambda m: lanesim.Worlds(m, 1).get(["contct_dist"]), 'did you mean "contact_dist"'),
        (lambda m: lanesim.Worlds(m, 1).get("zzzzzz"), "lanesim.OUTPUTS lists what there is"),
        (lambda m: lanesim.Worlds(m, 1).get(3), "output 3 is a int; expected a name"),
        (
            lambda m: lanesim.Worlds(m, 1).set("geom_frction", 1.0),
            'there is no field geom_frction; did you mean "geom_friction"',
        ),
        (lambda m: lanesim.Worlds(m, 1).set("qvl", [0.0]), 'did you mean "qvel"'),
        (lambda m: lanesim.rollout(m, np.zeros(3), outputs=["xpso"]), 'did you mean "xpos"'),
        (lambda m: m.opt.timestp, 'did you mean "timestep"'),
        (lambda m: m.body_mas, 'no attribute body_mas; did you mean "body_mass"'),
        (lambda m: m.id("joint", "hing"), 'there is no joint hing; did you mean "hinge"'),
        (lambda m: m.names("bodi"), 'did you mean "body"'),
        (lambda m: m.key("upp"), 'did you mean "up"'),
        (lambda m: m.replace(timestp=1), 'did you mean "timestep"'),
    ],
)
def test_unknown_names_come_with_the_nearest(pendulum, call, text) -> None:
    with pytest.raises((ValueError, AttributeError), match=text) as caught:
        call(pendulum)
    assert len(str(caught.value)) < 200 or "valid:" in str(caught.value)


def test_an_mjmodel_with_sensors_is_taken_over() -> None:
    path = corpus.MODELS / "unit" / "sensors.xml"
    exact = mujoco.MjModel.from_xml_path(str(path))
    model = lanesim.Model.from_mjmodel(exact)
    assert model.nsensordata == exact.nsensordata
    same(exact, model)


def test_rollouts_have_mujocos_sensordata() -> None:
    from mujoco import rollout

    exact = mujoco.MjModel.from_xml_path(str(corpus.MODELS / "unit" / "sensors.xml"))
    model = lanesim.Model.from_mjmodel(exact)
    data = mujoco.MjData(exact)
    start = np.empty((1, mujoco.mj_stateSize(exact, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)))
    mujoco.mj_getState(exact, data, start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
    control = np.full((1, 20, exact.nu), 0.1)
    _, wanted = rollout.rollout(exact, data, start, control)
    _, found = lanesim.rollout(model, start, control)
    scale = np.maximum(np.abs(wanted).max(axis=1, keepdims=True), 1.0)
    assert np.abs((found - wanted) / scale).max() < 1e-6
    _, again, recorded = lanesim.rollout(model, start, control, outputs=["sensordata"])
    assert np.array_equal(again, found) and np.array_equal(recorded["sensordata"], found)


def test_velocities_of_subtrees_are_mujocos(rng) -> None:
    path = MODELS / "zoo" / "humanoid27.xml"
    m = mujoco.MjModel.from_xml_path(str(path))
    worlds = lanesim.Worlds(lanesim.Model.from_xml_path(path), 4, "f64", 1)
    worlds.set("qvel", rng.normal(0, 1, (4, m.nv)))
    got = worlds.get("subtree_linvel")
    for world in range(4):
        data = mujoco.MjData(m)
        data.qpos[:], data.qvel[:] = worlds.qpos[world], worlds.qvel[world]
        mujoco.mj_fwdPosition(m, data)
        mujoco.mj_fwdVelocity(m, data)
        mujoco.mj_subtreeVel(m, data)
        np.testing.assert_allclose(got[world], data.subtree_linvel, rtol=0, atol=1e-10)


def test_bodies_without_mass_and_ranges_of_free_joints_are_taken_over() -> None:
    exact = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
          <body quat=".7071068 .7071068 0 0"><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>
            <body><joint/><geom size=".1"/></body></body>
          <body pos="0 0 1"><joint type="free" range="-60 60"/><geom size=".1"/></body></worldbody></mujoco>"""
    )
    same(exact, lanesim.Model.from_mjmodel(exact))


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.1])
def test_faces_of_meshes_are_mujocos(turn) -> None:
    # A drum of many flat sides, two milliradians apart, of which MuJoCo takes several as one, on a box.
    angles = turn + np.linspace(-0.06, 0.06, 61)
    sides = [[x, y, z] for x, z in zip(np.sin(angles), np.cos(angles), strict=True) for y in (-0.2, 0.2)]
    sine, cosine = np.sin(turn), np.cos(turn)
    back = [[x * cosine - 0.5 * sine, y, -x * sine - 0.5 * cosine] for x in (-0.1, 0.1) for y in (-0.2, 0.2)]
    vertices = " ".join(map(repr, np.ravel(sides + back).tolist()))
    for lean in (0.003, 0.011, 0.024, 0.031):
        # The box is below, where the middle of the drum's sides looks to.
        text = f"""<mujoco><asset><mesh name="drum" vertex="{vertices}"/></asset><worldbody>
          <geom type="box" size="1 1 .1" pos="0 0 -.1"/>
          <body pos="0 0 .999" euler="0 {np.degrees(np.pi - turn - lean)} 0"><freejoint/><geom type="mesh" mesh="drum"/></body>
          </worldbody></mujoco>"""
        m = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(m)
        mujoco.mj_forward(m, data)
        frames = lanesim.Worlds(lanesim.Model.from_xml_string(text), 1, "f64", 1).get("contact_frame")[0]
        assert len(frames) == data.ncon == 4
        # Contacts have the normal of a side of the mesh: of which one that is nearly level, MuJoCo chooses by the order of its list.
        normals = m.mesh_polynormal @ data.geom_xmat[1].reshape(3, 3).T
        for frame in np.reshape(frames, (-1, 9)):
            assert np.abs(normals + frame[:3]).max(1).min() < 1e-9


@pytest.mark.parametrize("name", ["ant", "hopper", "walker"])
def test_few_iterations_leave_what_they_leave_with_mujoco(name) -> None:
    path = MODELS / "zoo" / f"{name}.xml"
    m = mujoco.MjModel.from_xml_path(str(path))
    few = {"iterations": 2, "ls_iterations": 20, "solver": "Newton", "cone": "pyramidal", "integrator": "Euler"}
    m.opt.iterations, m.opt.ls_iterations = few["iterations"], few["ls_iterations"]
    m.opt.solver, m.opt.cone = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtCone.mjCONE_PYRAMIDAL
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    worlds = lanesim.Worlds(lanesim.Model.from_xml_path(path, options=few), 1, "f64", 1)
    errors = []
    for data in corpus.states(m, 12):
        worlds.set("qpos", data.qpos[None])
        worlds.set("qvel", data.qvel[None])
        worlds.set("ctrl", data.ctrl[None])
        data.qacc_warmstart[:] = 0
        worlds.set("qacc_warmstart", data.qacc_warmstart[None])
        mujoco.mj_forward(m, data)
        errors.append(np.abs(worlds.get("qacc")[0] - data.qacc).max() / np.abs(data.qacc).max())
    assert np.median(errors) < 1e-6
