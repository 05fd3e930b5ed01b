# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frames of the robots of a profile: one tree per robot in which every sensor has a place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from cdff_common.contract.wiring import Wiring
from cdff_common.geometry.urdf import read_urdf
from cdff_common.interfaces.profile import Robot
from cdff_common.interfaces.profile_checks.faults import (
    ABSENT,
    Finding,
    Severity,
    nearest_frame,
)
from cdff_common.interfaces.profile_checks.reading import Reading
from cdff_common.interfaces.yaml_file import Location

#: Largest deviation of the norm of a quaternion from 1, for quaternions with two decimals.
_QUATERNION_TOLERANCE = 0.01


@dataclass(slots=True)
class FrameParents:
    """Frames of a robot: the parent of each child, and the index of its edge (None for a URDF joint)."""

    parents: dict[str, str] = field(default_factory=dict)
    edges: dict[str, int | None] = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """Names of all frames."""
        return {*self.parents, *self.parents.values()}

    def chain(self, frame: str) -> list[str]:
        """Return a frame, its parent and so on; it ends before a frame that occurs twice."""
        chain = [frame]
        while (parent := self.parents.get(chain[-1])) is not None and parent not in chain:
            chain.append(parent)
        return chain

    def is_in_loop(self, frame: str) -> bool:
        """Return True if a frame is its own ancestor."""
        return self.chain(self.parents.get(frame, ""))[-1] == frame

    def root(self, frame: str) -> str:
        """Return the last frame of the chain of a frame."""
        return self.chain(frame)[-1]


def frame_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the findings of the frames of every robot."""
    assert reading.profile is not None
    robot_ids = set(reading.profile.robot_ids)
    for i, robot in enumerate(reading.profile.robots):
        frames = FrameParents()
        yield from _edge_findings(robot, i, frames, robot_ids)
        if reading.is_unreadable("robots", i, "frames"):
            continue  # placement of sensors is unknown while an edge is
        loops = [child for child in frames.parents if frames.is_in_loop(child)]
        if loops:
            edge = max((e for child in loops if (e := frames.edges[child]) is not None), default=0)
            place: Location = ("robots", i, "frames", edge)
            yield Finding(place, f"closes a loop of {', '.join(loops)}; expected a tree", ABSENT)
            continue
        if reading.is_unreadable("robots", i, "urdf"):
            continue
        yield from _root_findings(robot, i, frames)
        yield from _sensor_findings(reading, robot, i, frames)


def owner_of(frame: str) -> str:
    """Return ``mana`` of ``mana/base``, and an empty string for a frame with one part."""
    return frame.split("/", maxsplit=1)[0] if "/" in frame else ""


def used_sensors(reading: Reading, robot: Robot) -> set[str]:
    """Return the sensors that are inputs of the DFPCs of a robot or are archived."""
    assert reading.profile is not None
    sensor_names = {policy.sensor for policy in reading.profile.history if policy.robot in (None, robot.id)}
    for entry in robot.dfpcs:
        for wiring in entry.inputs.values():
            sensor_names |= {
                source.owner for source in Wiring.parse(wiring).sources if source.kind == "sensor"
            }
    return sensor_names


def _edge_findings(robot: Robot, i: int, frames: FrameParents, robot_ids: set[str]) -> Iterator[Finding]:
    """Yield the findings about the frames of a robot, and add its edges to ``frames``."""
    if robot.urdf:
        model = read_urdf(robot.urdf)
        for joint in model.joints:
            child = model.frame(robot.id, joint.child)
            frames.parents[child], frames.edges[child] = model.frame(robot.id, joint.parent), None
    for k, edge in enumerate(robot.frames):
        place: Location = ("robots", i, "frames", k)
        yield from _foreign_frames(robot, edge.parent, edge.child, place, robot_ids)
        if edge.parent == edge.child:
            yield Finding((*place, "child"), "is its own parent, expected two frames", edge.child)
            continue
        if edge.quaternion_xyzw is not None:
            norm = float(np.linalg.norm(edge.quaternion_xyzw))
            if abs(norm - 1.0) > _QUATERNION_TOLERANCE:
                problem = f"has the norm {norm:.3g}, expected a unit quaternion [x, y, z, w]"
                yield Finding((*place, "quaternion_xyzw"), problem, list(edge.quaternion_xyzw))
        if edge.child in frames.parents:
            parent = frames.parents[edge.child]
            if frames.edges[edge.child] is None:
                problem = f"is also the child of {parent} in the URDF, expected one parent"
            elif parent == edge.parent:
                problem = f"has this edge twice (frames[{frames.edges[edge.child]}]), expected one"
            else:
                problem = f"has two parents, {parent} and {edge.parent}; expected one"
            yield Finding((*place, "child"), problem, edge.child)
            continue
        frames.parents[edge.child], frames.edges[edge.child] = edge.parent, k


def _foreign_frames(
    robot: Robot, parent: str, child: str, place: Location, robot_ids: set[str]
) -> Iterator[Finding]:
    """Yield a finding if an edge connects a frame of another robot, or belongs to another robot.

    Bodies that are no robots of the profile, such as a client, may have frames; the robot may start in one of
    these or of a site.
    """
    owners = {"parent": owner_of(parent), "child": owner_of(child)}
    is_body = owners["parent"] not in robot_ids - {robot.id}
    if is_body and (owners["parent"] == owners["child"] or child in (f"{robot.id}/odom", f"{robot.id}/base")):
        return
    for key, frame in (("parent", parent), ("child", child)):
        if owners[key] not in ("", robot.id):
            problem = f"is a frame of {owners[key]}, expected one of {robot.id}"
            local_name = frame.partition("/")[2]
            yield Finding((*place, key), problem, frame, f"{robot.id}/{local_name}")


def _root_findings(robot: Robot, i: int, frames: FrameParents) -> Iterator[Finding]:
    """Yield the findings of trees that hang on no base, odom or site."""
    roots = {frames.root(child) for child in frames.parents}
    for root in sorted(roots - {frames.root(f"{robot.id}/base"), f"{robot.id}/odom"}):
        if owner_of(root) != robot.id:
            continue  # site, inertial, a body; frames of other robots are reported at their edge
        below = [child for child, parent in frames.parents.items() if parent == root]
        edge = min(e for child in below if (e := frames.edges[child]) is not None)
        known = frames.names - {root, *below}
        problem = (
            f"this frame has no parent: {', '.join(sorted(below))} below it cannot be placed on the robot; "
            f"expected an edge with this child, up to {robot.id}/base"
        )
        yield Finding(("robots", i, "frames", edge, "parent"), problem, root, nearest_frame(root, known))


def _sensor_findings(reading: Reading, robot: Robot, i: int, frames: FrameParents) -> Iterator[Finding]:
    """Yield the findings about frames of sensors that do not exist or belong to another robot."""
    used_names = used_sensors(reading, robot)
    base = f"{robot.id}/base"
    known = {base, *frames.names}
    for name, sensor in robot.sensors.items():
        place: Location = ("robots", i, "sensors", name, "frame")
        if owner_of(sensor.frame) not in ("", robot.id):
            problem = f"is a frame of {owner_of(sensor.frame)}, expected one of {robot.id}"
            yield Finding(place, problem, sensor.frame, nearest_frame(sensor.frame, known))
        elif sensor.frame not in known:
            problem = f"no such frame; expected one with an edge in frames, below {base}"
            severity = _severity(name in used_names)
            yield Finding(place, problem, sensor.frame, nearest_frame(sensor.frame, known), severity)
        elif frames.root(sensor.frame) in _roots_of_motion(robot) - {frames.root(base)}:
            chain = " ← ".join(reversed(frames.chain(sensor.frame)))
            problem = f"is not below {base} ({chain}); expected a chain of frames from the base to the sensor"
            yield Finding(place, problem, sensor.frame, "", _severity(name in used_names))


def _severity(is_used: bool) -> Severity:
    return "error" if is_used else "warning"


def _roots_of_motion(robot: Robot) -> set[str]:
    """Return the frames in which the robot moves: a sensor below them is not fixed to it."""
    parents = {edge.parent for edge in robot.frames if not owner_of(edge.parent)}
    return {"site", f"{robot.id}/odom", *parents}
