"""Models built in code."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

__all__ = ["Element", "Spec"]


def _text(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    return " ".join(_text(x) for x in np.asarray(value).reshape(-1).tolist())


class Element:
    """An element of MJCF, to which others can be added."""

    def __init__(self, element: ElementTree.Element) -> None:
        self._element = element

    def add(self, tag: str, **attributes: Any) -> "Element":
        """Adds an element and returns it. Attributes are MJCF's (``class_`` for ``class``); numbers, sequences and
        booleans are written as MJCF wants them, and None is left out."""
        given = {k.rstrip("_"): _text(v) for k, v in attributes.items() if v is not None}
        return Element(ElementTree.SubElement(self._element, tag, given))

    def set(self, **attributes: Any) -> "Element":
        """Sets attributes and returns the element."""
        for name, value in attributes.items():
            self._element.set(name.rstrip("_"), _text(value))
        return self


class Spec(Element):
    """A model before compilation, built element by element as MJCF would have it.

    >>> spec = Spec("pendulum")
    >>> arm = spec.worldbody.add("body", name="arm", pos=(0, 0, 1))
    >>> _ = arm.add("joint", axis=(0, 1, 0))
    >>> _ = arm.add("geom", type="capsule", size=(0.02, 0.25), pos=(0, 0, -0.25))
    >>> lanesim.Model.from_spec(spec).nq
    1
    """

    def __init__(self, model: str = "") -> None:
        super().__init__(ElementTree.Element("mujoco", {"model": model}))

    def _section(self, tag: str) -> Element:
        found = self._element.find(tag)
        return self.add(tag) if found is None else Element(found)

    @property
    def worldbody(self) -> Element:
        """The world, to which bodies, geoms and sites are added."""
        return self._section("worldbody")

    @property
    def option(self) -> Element:
        """Simulation options."""
        return self._section("option")

    @property
    def compiler(self) -> Element:
        """Compiler settings."""
        return self._section("compiler")

    @property
    def default(self) -> Element:
        """The default class."""
        return self._section("default")

    @property
    def contact(self) -> Element:
        """Explicit pairs and exclusions."""
        return self._section("contact")

    @property
    def actuator(self) -> Element:
        """Actuators."""
        return self._section("actuator")

    @property
    def keyframe(self) -> Element:
        """Keyframes."""
        return self._section("keyframe")

    def to_xml(self) -> str:
        """The model as MJCF text."""
        return ElementTree.tostring(self._element, encoding="unicode")
