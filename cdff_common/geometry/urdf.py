# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Links and joints of a URDF, for the frame tree of a robot; shapes and masses are ignored.

The format is that of the ROS package ``urdfdom`` (http://wiki.ros.org/urdf/XML). Joints of type floating and
planar have no single value and are refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from cdff_common.errors import ConfigurationError
from cdff_common.geometry import se3
from cdff_common.geometry.rotation_forms import matrix_from_rpy
from cdff_common.geometry.se3 import FloatArray

_ROTATING, _SLIDING, _FIXED = ("revolute", "continuous"), "prismatic", "fixed"


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """Joint of a robot.

    Attributes
    ----------
    name, kind : str
        Kind is ``revolute``, ``continuous``, ``prismatic`` or ``fixed``.
    parent, child : str
        Links.
    origin : array, shape (4, 4)
        ``T_parent_child`` at the value 0, metres.
    axis : array, shape (3,)
        Unit vector in the child.
    limits : tuple of float, optional
        Smallest and largest value, rad or m.
    mimic : tuple of (str, float, float), optional
        Mimicked joint, factor and offset.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: FloatArray
    axis: FloatArray
    limits: tuple[float, float] | None = None
    mimic: tuple[str, float, float] | None = None

    @property
    def movable(self) -> bool:
        """True if the joint has a value."""
        return self.kind != _FIXED

    def transform(self, value: float) -> FloatArray:
        """Return ``T_parent_child`` (4, 4) at a value in rad or m."""
        if self.kind in _ROTATING:
            return np.asarray(self.origin @ se3.transform(se3.exp_so3(value * self.axis), np.zeros(3)))
        if self.kind == _SLIDING:
            return np.asarray(self.origin @ se3.transform(np.eye(3), value * self.axis))
        return self.origin


@dataclass(frozen=True, slots=True)
class RobotModel:
    """Root link and joints of a robot, each joint after its ancestors."""

    name: str
    root: str
    joints: tuple[Joint, ...]

    def frame(self, robot: str, link: str) -> str:
        """Return the frame id of a link: ``{robot}/base`` for the root, else ``{robot}/{link}``, in lower
        case.
        """
        return f"{robot}/base" if link == self.root else f"{robot}/{re.sub(r'[^a-z0-9_]', '_', link.lower())}"


def read_urdf(text: str) -> RobotModel:
    """Return the model of a URDF document.

    Raises
    ------
    ConfigurationError
        If the document is no URDF or has a document type declaration, links and joints do not form one tree,
        or a joint has another type.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ConfigurationError("URDF: contains a document type declaration, expected none")
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ConfigurationError(f"URDF: {error}") from error
    if robot.tag != "robot":
        raise ConfigurationError(f"URDF: root element <{robot.tag}>, expected <robot>")
    links = [_required_attribute(link, "name", "link") for link in robot.findall("link")]
    joints = [_joint(element) for element in robot.findall("joint")]
    for names, kind in ((links, "link"), ([j.name for j in joints], "joint")):
        repeated = {n for n in names if names.count(n) > 1}
        if repeated:
            raise ConfigurationError(f"URDF: {kind} {min(repeated)!r} is repeated")
    movable = {j.name for j in joints if j.movable}
    for joint in joints:
        if joint.mimic is not None and joint.mimic[0] not in movable:
            raise ConfigurationError(
                f"URDF: joint {joint.name!r} mimics {joint.mimic[0]!r}, expected a movable joint"
            )
    return RobotModel(robot.get("name", ""), *_order_joints(links, joints))


def _order_joints(links: list[str], joints: list[Joint]) -> tuple[str, tuple[Joint, ...]]:
    """Return the root and the joints in top-down order."""
    children = {j.child for j in joints}
    unknown = sorted((children | {j.parent for j in joints}) - set(links))
    roots = [link for link in links if link not in children]
    if unknown or len(roots) != 1 or len(children) != len(joints):
        raise ConfigurationError(
            f"URDF: {len(links)} links, roots {roots}, links of joints that are missing {unknown}: expected "
            "one tree with one root"
        )
    reached, ordered = {roots[0]}, list[Joint]()
    while len(ordered) < len(joints):
        ready = [j for j in joints if j.parent in reached and j.child not in reached]
        if not ready:
            raise ConfigurationError("URDF: joints close a loop, expected a tree")
        ordered += ready
        reached |= {j.child for j in ready}
    return roots[0], tuple(ordered)


def _joint(element: ElementTree.Element) -> Joint:
    """Return the joint of an element; raises ConfigurationError if it is malformed or of another kind."""
    name = _required_attribute(element, "name", "joint")
    kind = _required_attribute(element, "type", f"joint {name!r}")
    if kind not in (*_ROTATING, _SLIDING, _FIXED):
        raise ConfigurationError(
            f"URDF: joint {name!r} is {kind}, expected revolute, continuous, prismatic or fixed"
        )
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None:
            raise ConfigurationError(f"URDF: joint {name!r} has no <{tag}>")
        ends.append(_required_attribute(end, "link", f"<{tag}> of joint {name!r}"))
    origin = origin_of(element, f"joint {name!r}")
    direction = numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), f"joint {name!r}")
    length = float(np.linalg.norm(direction))
    if kind != _FIXED and length < 1e-9:
        raise ConfigurationError(
            f"URDF: joint {name!r} has the axis {direction.tolist()}, expected a direction"
        )
    limit, mimic = element.find("limit"), element.find("mimic")
    limits = None
    if limit is not None and kind in ("revolute", _SLIDING):
        limits = _number(limit, "lower", 0.0, name), _number(limit, "upper", 0.0, name)
    mimic_rule = None
    if mimic is not None:
        mimicked = _required_attribute(mimic, "joint", f"<mimic> of joint {name!r}")
        mimic_rule = mimicked, _number(mimic, "multiplier", 1.0, name), _number(mimic, "offset", 0.0, name)
    return Joint(name, kind, ends[0], ends[1], origin, direction / max(length, 1e-9), limits, mimic_rule)


def _required_attribute(element: ElementTree.Element, attribute: str, where: str) -> str:
    """Return an attribute; raises ConfigurationError if it is missing or empty."""
    value = element.get(attribute, "")
    if not value:
        raise ConfigurationError(f"URDF: {where} has no attribute {attribute}")
    return value


def _number(element: ElementTree.Element, attribute: str, default: float, joint: str) -> float:
    return float(numbers(element, attribute, (default,), f"joint {joint!r}")[0])


def origin_of(element: ElementTree.Element, where: str) -> FloatArray:
    """Return the transform (4, 4) of the ``origin`` of a joint or shape, metres."""
    origin, zeros = element.find("origin"), (0.0, 0.0, 0.0)
    R = matrix_from_rpy(numbers(origin, "rpy", zeros, where))
    return se3.transform(R, numbers(origin, "xyz", zeros, where))


def numbers(
    element: ElementTree.Element | None, attribute: str, default: tuple[float, ...], where: str
) -> FloatArray:
    """Return as many finite numbers of an attribute as there are defaults; raises ConfigurationError.

    An attribute whose defaults are NaN is required.
    """
    text = None if element is None else element.get(attribute)
    try:
        values = np.array(default if text is None else [float(t) for t in text.split()], dtype=np.float64)
    except ValueError as error:
        raise ConfigurationError(f"URDF: {where}: {attribute}={text!r}, expected numbers") from error
    if values.shape != (len(default),) or not np.isfinite(values).all():
        raise ConfigurationError(
            f"URDF: {where}: {attribute}={text!r}, expected {len(default)} finite numbers"
        )
    return values
