"""What the tests share: models, MuJoCo beside lanesim, random states."""

from __future__ import annotations

import pathlib

import lanesim
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"

PENDULUM = """
<mujoco model="pendulum">
  <worldbody>
    <body name="arm" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping=".1"/>
      <geom name="rod" type="capsule" size=".02 .25" pos="0 0 -.25"/>
      <site name="tip" pos="0 0 -.5"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge" ctrlrange="-1 1"/></actuator>
  <keyframe><key name="up" time="2" qpos="3.14" qvel=".5" ctrl=".25"/></keyframe>
</mujoco>
"""


@pytest.fixture
def pendulum() -> lanesim.Model:
    return lanesim.Model.from_xml_string(PENDULUM)


@pytest.fixture(scope="session")
def ant() -> lanesim.Model:
    return lanesim.Model.from_xml_path(MODELS / "zoo" / "ant.xml")


@pytest.fixture(scope="session")
def humanoid() -> lanesim.Model:
    return lanesim.Model.from_xml_path(MODELS / "zoo" / "humanoid18.xml")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
