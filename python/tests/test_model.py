"""`lanesim.Model`: loading, names, options, pickles, errors."""

from __future__ import annotations

import copy
import gc
import pickle
import subprocess
import sys
import weakref

import lanesim
import mujoco
import numpy as np
import pytest
from conftest import MODELS, PENDULUM


def test_sizes_and_arrays(ant) -> None:
    assert (ant.nq, ant.nv, ant.nu) == (15, 14, 8)
    assert ant.body_mass.shape == (ant.nbody,)
    assert ant.qpos0.dtype == np.float64 and ant.jnt_type.dtype == np.int32
    with pytest.raises(ValueError, match="read-only"):
        ant.body_mass[1] = 0.0
    with pytest.raises(AttributeError, match="no attribute body_mas"):
        ant.body_mas
    assert set(ant.array_names) <= set(dir(ant))


def test_names(pendulum) -> None:
    assert pendulum.names("body") == ["world", "arm"]
    assert pendulum.id("site", "tip") == 0
    with pytest.raises(lanesim.UnknownNameError, match="there is no joint knee; valid: hinge"):
        pendulum.id("joint", "knee")
    with pytest.raises(lanesim.UnknownNameError, match="no kind of element camera"):
        pendulum.names("camera")


def test_keyframes(pendulum) -> None:
    key = pendulum.key("up")
    assert (key.name, key.time, key.qpos[0], key.qvel[0], key.ctrl[0]) == ("up", 2.0, 3.14, 0.5, 0.25)
    assert pendulum.key(0).qpos == key.qpos
    for bad in (0.5, True, -1, 7):
        with pytest.raises(ValueError, match="key"):
            pendulum.key(bad)


def test_options(pendulum) -> None:
    worlds = lanesim.Worlds(pendulum, 1)
    assert pendulum.opt.timestep == 0.002 and pendulum.opt.solver == lanesim.Solver.Newton
    pendulum.opt.timestep = 0.01
    pendulum.opt.solver = int(mujoco.mjtSolver.mjSOL_CG)
    pendulum.opt.gravity = [0.0, 0.0, -1.0]
    pendulum.opt.set(cone="elliptic", damper=False)
    assert pendulum.opt.timestep == 0.01 and pendulum.opt.solver.name == "CG"
    assert pendulum.opt.cone == lanesim.Cone.elliptic and not pendulum.opt.flags["damper"]
    np.testing.assert_array_equal(pendulum.opt.gravity, [0, 0, -1])
    worlds.step()
    assert worlds.time[0] == 0.002, "worlds keep the model with which they were made"
    assert lanesim.Worlds(pendulum, 1).model.opt.timestep == 0.01
    other = pendulum.replace(timestep=0.5)
    assert (other.opt.timestep, pendulum.opt.timestep) == (0.5, 0.01)


@pytest.mark.parametrize(
    "options, text",
    [
        ({"timestp": 1}, 'unknown option "timestp"'),
        ({"solver": "newton"}, 'option "solver"'),
        ({"solver": 7}, "option solver is 7; expected one of PGS"),
        ({"iterations": -1}, "negative"),
        ({"timestep": "fast"}, 'option "timestep"'),
        ({"timestep": None}, "not the value of an option"),
    ],
)
def test_bad_options(pendulum, options, text) -> None:
    with pytest.raises(ValueError, match=text):
        pendulum.replace(**options)
    with pytest.raises(ValueError, match=text):
        lanesim.Model.from_xml_string(PENDULUM, options=options)
    with pytest.raises(AttributeError, match='there is no option timestp; did you mean "timestep"'):
        pendulum.opt.timestp = 1


def test_pickles(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text("<mujoco><include file='sub/geom.xml'/></mujoco>")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "geom.xml").write_text("<mujoco><geom size='.1'/><geom type='sdf'/></mujoco>")
    main = "<mujoco><worldbody><body><joint/><include file='arm.xml'/></body></worldbody></mujoco>"
    (tmp_path / "main.xml").write_text(main)
    with pytest.warns(lanesim.LossWarning, match="signed distance fields are not supported"):
        model = lanesim.Model.from_xml_path(tmp_path / "main.xml", lenient=True, options={"timestep": 0.001})
    model.opt.set(density=0.0, contact=False)
    data = pickle.dumps(model)
    for file in ("main.xml", "arm.xml", "sub/geom.xml"):
        (tmp_path / file).unlink()
    again = pickle.loads(data)
    assert again.report() == model.report() and model.report().losses
    assert again.opt.timestep == 0.001 and not again.opt.flags["contact"]
    for name in model.array_names:
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    assert copy.deepcopy(model).nq == model.nq
    assert pickle.dumps(again) == data
    # What is set again replaces what was set before: only the last of both is kept. Gravity is an option and a flag.
    model.opt.timestep = 0.002
    model.opt.timestep = 0.003
    model.opt.set(contact=True)
    model.opt.set(contact=False)
    model.opt.set(gravity=(0, 0, -1))
    model.opt.set(gravity=(0, 0, -2))
    again = pickle.loads(pickle.dumps(model))
    assert again.opt.timestep == 0.003 and not again.opt.flags["contact"] and again.opt.gravity[2] == -2
    assert not {"ipc", "speculative"} & {name for name, on in again.opt.flags.items() if on}
    assert {"ipc", "speculative"} <= set(again.opt.flags)


def test_assets() -> None:
    main = "<mujoco><include file='arm.xml'/></mujoco>"
    arm = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    for content in (arm, arm.encode()):
        model = lanesim.Model.from_xml_string(main, {"arm.xml": content, "picture.png": b"\x89PNG\xff"})
        assert model.nq == 1 and pickle.loads(pickle.dumps(model)).nq == 1
    with pytest.raises(TypeError, match="assets is a list; expected a dict"):
        lanesim.Model.from_xml_string(main, ["arm.xml"])
    with pytest.raises(lanesim.ModelError, match="no such file among those given"):
        lanesim.Model.from_xml_string(main)


def test_meshes_are_assets() -> None:
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces)
    xml = """<mujoco><compiler meshdir='shapes'/><asset><mesh file='cube.obj' scale='.1 .1 .1'/></asset>
      <worldbody><body><freejoint/><geom type='mesh' mesh='cube'/></body></worldbody></mujoco>"""
    model = lanesim.Model.from_xml_string(xml, {"shapes/cube.obj": obj.encode(), "picture.png": b"\x89PNG\xff"})
    np.testing.assert_allclose(model.body_mass[1], 8, rtol=1e-6)
    np.testing.assert_allclose(model.geom_size[0], 0.1, rtol=1e-6)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.body_inertia, model.body_inertia)
    with pytest.raises(lanesim.ModelError, match='mesh: file "shapes/cube.obj": no such file among those given'):
        lanesim.Model.from_xml_string(xml)


def test_specs() -> None:
    spec = lanesim.Spec("pendulum")
    spec.option.set(timestep=0.005)
    arm = spec.worldbody.add("body", name="arm", pos=(0, 0, 1))
    arm.add("joint", name="hinge", axis=np.array([0, 1, 0]), limited=True, range=(-90, 90))
    arm.add("geom", type="capsule", size=(0.02, 0.25), pos=(0, 0, -0.25), class_=None)
    spec.actuator.add("motor", joint="hinge")
    model = lanesim.Model.from_spec(spec)
    assert (model.nq, model.nu, model.opt.timestep) == (1, 1, 0.005)
    exact = mujoco.MjSpec.from_string(PENDULUM)
    assert lanesim.Model.from_spec(exact).nsite == 1
    with pytest.raises(TypeError, match="no method to_xml"):
        lanesim.Model.from_spec(PENDULUM)


def test_rejections_name_the_place(tmp_path) -> None:
    file = tmp_path / "bad.xml"
    file.write_text("<mujoco>\n<worldbody>\n<geom type='torus'/>\n<geom size='x'/>\n</worldbody>\n</mujoco>")
    with pytest.raises(lanesim.ModelError, match=r"bad.xml:3: geom") as info:
        lanesim.Model.from_xml_path(file)
    error = info.value
    assert isinstance(error, (lanesim.LanesimError, ValueError))
    assert [d.line for d in error.diagnostics] == [3, 4]
    assert pickle.loads(pickle.dumps(error)).diagnostics == error.diagnostics
    with pytest.raises(lanesim.ModelError, match="nowhere.xml"):
        lanesim.Model.from_xml_path(tmp_path / "nowhere.xml")
    for text in ("", "<mujoco", "<robot/>", "\0", "<mujoco><worldbody>" + "<body>" * 100_000):
        with pytest.raises(lanesim.ModelError):
            lanesim.Model.from_xml_string(text)
    with pytest.raises(TypeError, match="expected str"):
        lanesim.Model.from_xml_string(b"<mujoco/>")


def test_a_model_may_go_before_its_worlds() -> None:
    model = lanesim.Model.from_xml_path(MODELS / "zoo" / "ant.xml")
    worlds = lanesim.Worlds(model, 8)
    gone = weakref.ref(model)
    del model
    gc.collect()
    assert gone() is None
    worlds.step(10)
    assert worlds.get("xpos").shape == (8, worlds.model.nbody, 3)


def test_the_first_import_is_quiet() -> None:
    program = "import lanesim, sys; assert 'mujoco' not in sys.modules and 'gymnasium' not in sys.modules"
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
