"""Second derivatives of costs, and means over noise, against what is known of them."""

import math

import lanesim
import numpy as np
import pytest

from conftest import MODELS

PENDULUM = """<mujoco><option gravity="0 0 -9.81" timestep="0.01"/><worldbody><body>
  <joint name="hinge" axis="0 1 0" damping="0.3" armature="0.1"/>
  <geom type="sphere" size="0.05" pos="0 0 -0.7" mass="2"/></body></worldbody>
  <actuator><motor joint="hinge" gear="1.5" ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""
INERTIA = 2 * 0.7**2 + 0.4 * 2 * 0.05**2 + 0.1
WEIGHT = 2 * 9.81 * 0.7

BALL = """<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 0.1">
  <joint name="z" type="slide" axis="0 0 1"/><geom type="sphere" size="0.1"/></body></worldbody></mujoco>"""

BRICK = """<mujoco><option cone="elliptic"/><worldbody><geom type="plane" size="5 5 1" friction=".3"/><body pos="0 0 .099"><freejoint/>
  <geom type="box" size=".2 .2 .1" friction=".4"/></body></worldbody></mujoco>"""

SPINNER = """<mujoco><worldbody><body><freejoint/><geom type="box" size=".1 .2 .3" mass="1"/></body></worldbody></mujoco>"""


@pytest.fixture
def pendulum():
    return lanesim.Model.from_xml_string(PENDULUM)


def acceleration(q, v, u):
    return (1.5 * u - WEIGHT * np.sin(q) - 0.3 * v) / INERTIA


@pytest.mark.parametrize("centred", [True, False])
def test_a_pendulums_hessian_is_its_formula(pendulum, centred):
    states = [(0.3, 0.5, 0.2), (-1.2, 2.0, -0.7), (2.0, 0.0, 0.0)]
    q, v, u = np.array(states).T
    found = lanesim.hessian(
        pendulum,
        q[:, None],
        v[:, None],
        lambda after, before: 0.5 * after["qacc"][:, 0] ** 2 + before["qvel"][:, 0] * before["ctrl"][:, 0],
        of="acceleration",
        ctrl=u[:, None],
        centred=centred,
    )
    assert found.columns.tolist() == [0, 1, 2] and (found.sides == 2).all() and (found.status == 0).all()
    a = acceleration(q, v, u)
    slope = np.stack([-WEIGHT * np.cos(q), np.full(3, -0.3), np.full(3, 1.5)], axis=1) / INERTIA
    exact = slope[:, :, None] * slope[:, None, :]
    exact[:, 0, 0] += a * WEIGHT * np.sin(q) / INERTIA
    exact[:, 1, 2] += 1
    exact[:, 2, 1] += 1
    gradient = a[:, None] * slope + np.stack([np.zeros(3), u, v], axis=1)
    np.testing.assert_allclose(found.value, 0.5 * a**2 + v * u, rtol=1e-12)
    np.testing.assert_allclose(found.gradient, gradient, atol=1e-6 if centred else 2e-2)
    np.testing.assert_allclose(found.hessian, exact, atol=2e-5 if centred else 3e-2)
    np.testing.assert_array_equal(found.hessian, found.hessian.swapaxes(1, 2))


def test_controls_at_limits_are_moved_inwards(pendulum):
    control = np.array([[1.0], [-1.0], [0.99995], [3.0]])
    found = lanesim.hessian(
        pendulum,
        np.zeros((4, 1)),
        np.zeros((4, 1)),
        lambda after, before: 0.5 * after["qacc"] ** 2,
        of="acceleration",
        ctrl=control,
    )
    assert found.hessian.shape == (4, 1, 3, 3)
    assert found.sides.tolist() == [[2, 2, -1], [2, 2, 1], [2, 2, -1], [2, 2, 0]]
    second = (1.5 / INERTIA) ** 2
    np.testing.assert_allclose(found.hessian[:, 0, 2, 2], [second, second, second, 0], rtol=1e-5)
    mixed = -WEIGHT * 1.5 / INERTIA**2
    np.testing.assert_allclose(found.hessian[:, 0, 0, 2], [mixed, mixed, mixed, 0], rtol=1e-3)


def test_moves_of_a_rotation_add_in_the_tangent_space():
    """How upright a body is: R33 of R exp(w), whose second derivatives by w are (b_i d_j3 + b_j d_i3) / 2 - b_3 d_ij, b the third row of R."""
    model = lanesim.Model.from_xml_string(SPINNER)
    w, x, y, z = quat = np.array([0.8, 0.1, -0.5, 0.3]) / math.sqrt(0.99)
    b = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])

    def upright(after, before):
        q = before["qpos"]
        return 1 - 2 * (q[:, 4] ** 2 + q[:, 5] ** 2)

    qpos = np.concatenate([[0, 0, 1], quat])
    exact = -b[2] * np.eye(3)
    exact[2] += b / 2
    exact[:, 2] += b / 2
    for centred, error in [(True, 1e-6), (False, 1e-3)]:
        found = lanesim.hessian(model, qpos, np.zeros(6), upright, columns=[3, 4, 5], centred=centred)
        np.testing.assert_allclose(found.hessian, exact, atol=error)
        assert found.hessian.shape == (3, 3) and found.value.shape == ()


def test_gauss_newton_is_made_of_the_transitions_derivatives():
    model = lanesim.Model.from_xml_path(MODELS / "zoo" / "hopper.xml")
    rng = np.random.default_rng(2)
    qpos = model.qpos0 + rng.uniform(-0.05, 0.05, (2, 3, model.nq))
    qvel = rng.normal(size=(2, 3, model.nv))
    ctrl = rng.uniform(-0.5, 0.5, (2, 3, model.nu))

    def residuals(after, before):
        return np.concatenate([after["qpos"], 0.1 * after["qvel"]], axis=1)

    found = lanesim.hessian(model, qpos, qvel, residuals, ctrl=ctrl, gauss_newton=True)
    slopes = lanesim.transition(model, qpos, qvel, ctrl=ctrl)
    jacobian = np.concatenate([slopes.A, slopes.B], axis=-1)
    jacobian[..., model.nv :, :] *= 0.1
    scale = np.abs(found.hessian).max()
    np.testing.assert_allclose(found.hessian, jacobian.swapaxes(-1, -2) @ jacobian, atol=1e-7 * scale)
    assert found.value.shape == (2, 3) and found.gradient.shape == (2, 3, 2 * model.nv + model.nu)
    whole = lanesim.hessian(model, qpos, qvel, lambda *both: 0.5 * (residuals(*both) ** 2).sum(axis=1), ctrl=ctrl)
    # Where nothing begins or ends to touch.
    smooth = found.changed.max(axis=-1) + whole.changed.max(axis=-1) == 0
    assert smooth.any()
    np.testing.assert_allclose(found.gradient[smooth], whole.gradient[smooth], atol=1e-4 * np.abs(found.gradient).max())


def test_inverse_dynamics_have_hessians(pendulum):
    q, v, a = 0.4, 0.5, 2.0
    found = lanesim.hessian(
        pendulum,
        [q],
        [v],
        lambda after, before: 0.5 * after["qfrc_inverse"][:, 0] ** 2 * before["qacc"][:, 0],
        of="inverse",
        qacc=[a],
    )
    force = INERTIA * a + 0.3 * v + WEIGHT * math.sin(q)
    slope = np.array([WEIGHT * math.cos(q), 0.3, INERTIA])
    exact = a * np.outer(slope, slope)
    exact[0, 0] -= a * force * WEIGHT * math.sin(q)
    exact[2] += force * slope
    exact[:, 2] += force * slope
    np.testing.assert_allclose(found.hessian, exact, rtol=1e-5, atol=1e-4)


def test_states_one_by_one_have_the_same_bits():
    model = lanesim.Model.from_xml_path(MODELS / "zoo" / "ant.xml")
    rng = np.random.default_rng(4)
    qpos = np.tile(model.qpos0, (9, 1))
    qvel, ctrl = rng.normal(size=(9, model.nv)), rng.uniform(-1, 1, (9, model.nu))

    def cost(after, before):
        return (after["qvel"] ** 2).sum(axis=1)

    columns = [2, 5, 9, 15, 30, 37, 43]
    together = lanesim.hessian(model, qpos, qvel, cost, ctrl=ctrl, columns=columns, threads=2)
    for i, backend in enumerate(["auto", "scalar", "wide"]):
        alone = lanesim.hessian(
            model, qpos[i], qvel[i], cost, ctrl=ctrl[i], columns=columns, threads=1, backend=backend
        )
        for name in ("value", "gradient", "hessian", "sides", "changed", "status"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name)[i], name)


def test_bad_questions_have_clear_answers(pendulum):
    def ask(cost=lambda after, before: after["qvel"][:, 0], **kwargs):
        return lanesim.hessian(pendulum, [0.0], [0.0], cost, **kwargs)

    with pytest.raises(lanesim.InputError, match=r"cost returned an array of shape \[\]; expected \[14\]"):
        ask(lambda after, before: 3.0, ctrl=[0.0])
    with pytest.raises(lanesim.InputError, match="cost returned an array of type"):
        ask(lambda after, before: np.array(["x"] * len(after["qpos"])))
    with pytest.raises(lanesim.UnknownNameError, match="of is 'forward'"):
        ask(of="forward")
    with pytest.raises(lanesim.InputError, match="no array qacc"):
        ask(of="inverse")
    with pytest.raises(lanesim.InputError, match='qacc is for of="inverse"'):
        ask(qacc=[0.0])
    with pytest.raises(lanesim.InputError, match="do not look at qfrc_applied"):
        ask(of="inverse", qacc=[0.0], qfrc_applied=[0.0])
    with pytest.raises(lanesim.InputError, match="there is no column 4; there are 4"):
        ask(columns=[0, 4])
    with pytest.raises(lanesim.InputError, match="column 1 is named twice"):
        ask(columns=[1, 1])
    with pytest.raises(lanesim.OptionError, match="eps is 0"):
        ask(eps=0)
    with pytest.raises(ZeroDivisionError):
        ask(lambda after, before: 1 / 0)
    smoothed = dict(scale=0.1, pairs=10)
    with pytest.raises(lanesim.InputError, match="2 pairs of points for 3 columns"):
        lanesim.smoothed(pendulum, [0.0], [0.0], **{**smoothed, "pairs": 2})
    with pytest.raises(lanesim.InputError, match=r"`scale` has shape \[2\]; expected one number, \[3\], or \[4\]"):
        lanesim.smoothed(pendulum, [0.0], [0.0], **{**smoothed, "scale": [1, 2]})
    with pytest.raises(lanesim.InputError, match="column 0 is -1"):
        lanesim.smoothed(pendulum, [0.0], [0.0], **{**smoothed, "scale": -1.0})
    with pytest.raises(lanesim.InputError, match="no column has noise"):
        lanesim.smoothed(pendulum, [0.0], [0.0], **{**smoothed, "scale": 0.0})


def test_a_linear_model_is_smoothed_exactly():
    model = lanesim.Model.from_xml_string(
        """<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body><joint name="x" type="slide" stiffness="7"
        damping="0.5"/><geom size=".1" mass="2"/></body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
    )
    qpos, qvel, ctrl = np.array([[0.1], [-2.0]]), np.array([[1.0], [0.5]]), np.array([[0.3], [4.0]])
    slopes = lanesim.transition(model, qpos, qvel, ctrl=ctrl)
    found = lanesim.smoothed(model, qpos, qvel, ctrl=ctrl, scale=[0.5, 2.0, 1.0], pairs=5)
    np.testing.assert_allclose(found.gradient, np.concatenate([slopes.A, slopes.B], axis=-1), atol=1e-8)
    # Positions are differences from the one that follows from the state itself.
    np.testing.assert_allclose(found.mean[:, 0], 0, atol=1e-12)
    assert found.columns.tolist() == [0, 1, 2] and (found.changed == 0).all()


def test_a_clipped_control_is_smoothed_as_its_formula_says(pendulum):
    """Of a control that noise moves over its range, the share counts that stays inside."""
    control = np.array([[0.0], [0.8], [2.0]])
    found = lanesim.smoothed(
        pendulum, np.zeros((3, 1)), np.zeros((3, 1)), of="acceleration", ctrl=control, scale=[0, 0, 0.5], pairs=20000
    )
    assert found.columns.tolist() == [2] and found.gradient.shape == (3, 1, 1)

    def below(x):
        return 0.5 * (1 + math.erf(x / math.sqrt(2)))

    inside = [below((1 - u) / 0.5) - below((-1 - u) / 0.5) for u in control[:, 0]]
    np.testing.assert_allclose(found.gradient[:, 0, 0], np.array(inside) * 1.5 / INERTIA, atol=0.03)


def test_a_contact_is_smoothed_and_its_gradient_is_that_of_the_mean():
    """The gradient from one cloud, and the difference of the means of two with the same noise."""
    model = lanesim.Model.from_xml_string(BALL)
    height, step = 0.002, 1e-3
    qpos = np.array([[height], [height + step], [height - step]])
    qvel = np.full((3, 1), -0.05)
    how = dict(scale=[0.004, 0.0], pairs=1 << 14, seed=7)
    found = lanesim.smoothed(model, qpos, qvel, **how)
    speed = found.mean[:, 1]
    slope = (speed[1] - speed[2]) / (2 * step)
    # Above the floor and in it, speed does not depend on height alone: the slope is neither that of flight, 0, nor that of contact.
    contact = lanesim.transition(model, [-0.004], [-0.05]).A[1, 0]
    assert 0.05 < slope / contact < 0.95
    np.testing.assert_allclose(found.gradient[0, 1, 0], slope, rtol=0.05)
    assert 0.1 < found.changed[0] < 0.9
    again = lanesim.smoothed(model, qpos[:1], qvel[:1], backend="scalar", **how)
    np.testing.assert_array_equal(again.gradient, found.gradient[:1])
    other = lanesim.smoothed(model, qpos[:1], qvel[:1], **{**how, "seed": 8})
    assert not np.array_equal(other.mean, again.mean)


def test_costs_are_smoothed():
    model = lanesim.Model.from_xml_path(MODELS / "zoo" / "hopper.xml")
    qvel = np.zeros(model.nv)
    found = lanesim.smoothed(
        model,
        model.qpos0,
        qvel,
        lambda after, before: 3 * before["qvel"][:, 1] + before["ctrl"][:, 0],
        scale=0.01,
        pairs=40,
    )
    n = 2 * model.nv
    expected = np.zeros(n + model.nu)
    expected[model.nv + 1], expected[n] = 3, 1
    np.testing.assert_allclose(found.gradient, expected, atol=1e-9)
    assert abs(found.mean) < 1e-9 and found.mean.shape == ()


def test_derivatives_by_parameters_are_their_formulas(pendulum):
    q, v, u = np.array([0.3, -1.2]), np.array([0.5, 2.0]), np.array([0.2, -0.7])
    state = dict(qpos=q[:, None], qvel=v[:, None], ctrl=u[:, None])
    a = acceleration(q, v, u)

    def ask(parameter, **kwargs):
        return lanesim.parameter_derivatives(
            pendulum, state["qpos"], state["qvel"], parameter, ctrl=state["ctrl"], of="acceleration", **kwargs
        )

    found = ask("body_mass")
    assert found.slopes.shape == (2, 1, 2) and (found.status == 0).all()
    by_mass = -9.81 * 0.7 * np.sin(q) / INERTIA - a * 0.7**2 / INERTIA
    np.testing.assert_allclose(found.slopes[:, 0, 1], by_mass, rtol=1e-7)
    # The world itself has no mass.
    np.testing.assert_array_equal(found.slopes[:, 0, 0], 0)
    assert found.sides.tolist() == [0, 2]
    np.testing.assert_allclose(ask("dof_damping").slopes[:, 0, 0], -v / INERTIA, rtol=1e-7)
    np.testing.assert_allclose(ask("dof_armature").slopes[:, 0, 0], -a / INERTIA, rtol=1e-7)
    gravity = ask("gravity", entries=[2, 1])
    assert gravity.slopes.shape == (2, 1, 2) and gravity.sides.tolist() == [2, 2]
    np.testing.assert_allclose(gravity.slopes[:, 0, 0], 2 * 0.7 * np.sin(q) / INERTIA, rtol=1e-7)
    gear = ask("actuator_gear", entries=[0])
    np.testing.assert_allclose(gear.slopes[:, 0, 0], u / INERTIA, rtol=1e-7)
    # A stiffness of zero may not become negative.
    spring = ask("jnt_stiffness")
    assert spring.sides.tolist() == [1]
    np.testing.assert_allclose(spring.slopes[:, 0, 0], -q / INERTIA, rtol=1e-5)
    with pytest.raises(lanesim.InputError, match="body_mass has 2 numbers; there is no entry 2"):
        ask("body_mass", entries=[2])
    with pytest.raises(lanesim.UnknownNameError, match="there is no parameter body_masses; did you mean"):
        ask("body_masses")
    with pytest.raises(lanesim.OptionError, match="eps is 0"):
        ask("body_mass", eps=0)


def test_forces_are_linear_in_masses_and_inertias():
    """Inverse dynamics without contacts: what identification rests on."""
    model = lanesim.Model.from_xml_string(SPINNER)
    rng = np.random.default_rng(3)
    qpos = np.concatenate([rng.normal(size=(4, 3)), [[1, 0, 0, 0]] * 4], axis=1)
    qvel, qacc = rng.normal(size=(2, 4, model.nv))
    force = lanesim.inverse(model, qpos, qvel, qacc)
    total = 0
    for name in ("body_mass", "body_inertia"):
        found = lanesim.parameter_derivatives(model, qpos, qvel, name, of="inverse", qacc=qacc)
        value = getattr(model, name)
        assert found.slopes.shape == (4, model.nv, *value.shape)
        total = total + np.tensordot(found.slopes, value, value.ndim)
    np.testing.assert_allclose(total, force, rtol=1e-7, atol=1e-8)


def test_steps_follow_friction_where_something_slides():
    model = lanesim.Model.from_xml_string(BRICK)
    worlds = lanesim.Worlds(model, 1)
    worlds.step(500)
    worlds.qvel = [2, 0.3, 0, 0, 0, 0]
    assert worlds.get("ncon")[0] == 4
    qpos, qvel = worlds.qpos[0].copy(), worlds.qvel[0].copy()
    found = lanesim.parameter_derivatives(model, qpos, qvel, "geom_friction", eps=1e-5)
    assert found.slopes.shape == (2 * model.nv, *model.geom_friction.shape)
    # A step of models that were compiled with other numbers.
    eps = 1e-4
    place = np.unravel_index(np.abs(found.slopes).sum(axis=0).argmax(), model.geom_friction.shape)
    accurate = lanesim.Worlds(model.replace(solver="Newton", tolerance=1e-15, iterations=200), 2)
    friction = np.stack([model.geom_friction, model.geom_friction])
    friction[0][place] += eps
    friction[1][place] -= eps
    accurate.set("geom_friction", friction)
    accurate.qpos, accurate.qvel = qpos, qvel
    accurate.step()
    slope = (accurate.qvel[0] - accurate.qvel[1]) / (2 * eps)
    assert np.abs(slope).max() > 1e-3
    np.testing.assert_allclose(found.slopes[model.nv :, place[0], place[1]], slope, rtol=1e-4, atol=1e-5)
