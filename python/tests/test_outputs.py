"""Outputs of bodies and points, against MuJoCo."""

import lanesim
import mujoco
import numpy as np
import pytest

from conftest import MODELS

CASES = ["zoo/humanoid18", "unit/equality_weld", "zoo/four_bar"]


@pytest.mark.parametrize("name", CASES)
def test_bodies_and_points(name):
    path = MODELS / f"{name}.xml"
    reference = mujoco.MjModel.from_xml_path(str(path))
    reference.opt.tolerance, reference.opt.iterations, reference.opt.ls_tolerance = 1e-14, 200, 1e-6
    data = mujoco.MjData(reference)
    mujoco.mj_step(reference, data, 300)
    mujoco.mj_forward(reference, data)
    mujoco.mj_rnePostConstraint(reference, data)
    model = lanesim.Model.from_xml_path(path, options=dict(tolerance=1e-14, iterations=200, ls_tolerance=1e-6))
    worlds = lanesim.Worlds(model, 3, threads=1)
    worlds.qpos, worlds.qvel = data.qpos, data.qvel
    names = ["cvel", "cacc", "cfrc_int", "cfrc_ext"]
    found = worlds.get(names, ids=[2])
    for field in names:
        expected = getattr(data, field)
        np.testing.assert_allclose(found[field][0], expected, rtol=0, atol=1e-9 * (1 + np.abs(expected).max()))
    jac = np.zeros((6, reference.nv))
    body = reference.nbody - 1
    mujoco.mj_jacBody(reference, data, jac[:3], jac[3:], body)
    rows = worlds.rollout(nstep=2, outputs=[f"jac_body:{reference.body(body).name or body}"])
    (array,) = rows.values()
    assert array.shape == (3, 2, 6, model.nv)
    np.testing.assert_allclose(array[:, 0], np.broadcast_to(jac, (3, *jac.shape)), atol=1e-12)


def test_names_are_known():
    model = lanesim.Model.from_xml_path(MODELS / "zoo/humanoid18.xml")
    worlds = lanesim.Worlds(model, 1)
    with pytest.raises(lanesim.UnknownNameError, match="there is no site .* for the output jac_site:nowhere"):
        worlds.get("jac_site:nowhere")
    with pytest.raises(lanesim.UnknownNameError, match='there is no output cacx; did you mean "cacc"'):
        worlds.get("cacx")
    with pytest.raises(lanesim.UnknownNameError, match="is computed, not set"):
        worlds.set("jac_body:1", 0.0)
    assert "[nbody, 6]" in lanesim.OUTPUTS["cfrc_int"]


def test_fields_say_what_they_are():
    assert lanesim.Worlds.xfrc_applied.__doc__.endswith("[nworld, nbody, 6]")
    assert "m/s" in lanesim.Worlds.qvel.__doc__
