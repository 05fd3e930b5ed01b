# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoint of the position manager, and its conversion to and from PositionState."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import (
    PoseTrajectory,
    PositionState,
    PositionStateFilter,
    PositionStateJoints,
    PositionStateLinks,
    PositionStateMetadata,
)
from cdff_common.types.columns import pack_poses, unpack_poses
from cdff_core.dfpcs.position_manager.estimate import CORE_SIZE, Clone, Estimate
from cdff_core.dfpcs.position_manager.frame_tree import JointValues
from cdff_core.dfpcs.position_manager.measurement import ODOMETRIES
from cdff_core.dfpcs.position_manager.pose_timeline import Node

_FIELD = "PositionState"
#: Number of rows of ``vectors`` before those of the clones.
_VECTORS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """State of the position manager that survives a restart."""

    estimate: Estimate
    nodes: list[Node]
    pins: set[int]  # pinned times, nanoseconds
    T_odom_base: UncertainTransform  # pose at the start of the timeline
    gravity_m_s2: float | None
    joints: Mapping[str, JointValues]
    stamp_offsets_s: Mapping[str, float]  # offset of the stamps in use by odometry

    def to_message(self, base: str, producer: str) -> PositionState:
        """Return the message; times are rounded down to microseconds."""
        nodes, estimate = self.nodes, self.estimate
        stamps = np.array([n.stamp_ns for n in nodes]) // 1000
        trajectory = PoseTrajectory.from_arrays(
            stamps * 1000, np.array([n.pose for n in nodes]), parent="site", child=base, producer=producer
        )
        links = PositionStateLinks(
            np.concatenate([n.covariance for n in nodes]),
            np.concatenate([n.cross_covariance for n in nodes]),
            np.array(sorted(self.pins), dtype=np.int64) // 1000,
            stamps[[n.after_gap for n in nodes]],
        )
        clones = list(estimate.clones.values())
        offsets = [self.stamp_offsets_s.get(source, 0.0) for source in ODOMETRIES]
        scalars = [self.gravity_m_s2 or 0.0, estimate.wheel_speed_m_s, float(estimate.consecutive_refusals)]
        noise = [row for c in clones for row in ([c.noise_factor, float(c.refusals), 0.0], c.velocity)]
        filtered = PositionStateFilter(
            start=pack_poses(self.T_odom_base.matrix[None], _FIELD),
            start_covariance=_to_row(self.T_odom_base.covariance)[None],
            body=pack_poses(estimate.pose[None], _FIELD),
            vectors=np.array(
                [
                    estimate.velocity,
                    *estimate.biases.reshape(2, 3),
                    estimate.slip,
                    scalars,
                    *estimate.calibration.reshape(4, 3),
                    offsets,
                    *noise,
                ]
            ),
            names=tuple(estimate.clones),
            stamps=np.array([c.stamp_ns // 1000 for c in clones], dtype=np.int64),
            poses=pack_poses(np.array([c.pose for c in clones]), _FIELD),
            measured=pack_poses(np.array([c.measured.matrix for c in clones]), _FIELD),
            measured_covariances=np.array([_to_row(c.measured.covariance) for c in clones]).reshape(-1, 36),
            covariance=estimate.covariance.reshape(-1, 6),
        )
        metadata = PositionStateMetadata(producer_id=producer)
        return PositionState(metadata, trajectory, links, filtered, _joints_to_message(self.joints))

    @classmethod
    def from_message(cls, message: PositionState) -> Checkpoint:
        """Return the checkpoint in a message; raises InputError if field sizes are inconsistent."""
        _check_sizes(message)
        trajectory, links, f = message.line, message.links, message.filter
        n, size = len(trajectory.stamps_ns), CORE_SIZE + 6 * len(f.names)
        covariances, crosses = links.covariances.reshape(n, 9, 9), links.links.reshape(n, 9, 9)
        gaps = set(links.broken.tolist())
        nodes = [
            Node(int(t), T, C, X, int(t) // 1000 in gaps)
            for t, T, C, X in zip(
                trajectory.stamps_ns, trajectory.matrices, covariances, crosses, strict=True
            )
        ]
        measured_poses = [
            UncertainTransform(T, _from_row(C))
            for T, C in zip(unpack_poses(f.measured, _FIELD), f.measured_covariances, strict=True)
        ]
        poses = unpack_poses(f.poses, _FIELD)
        clones = {
            name: Clone(
                pose, m, int(stamp) * 1000, velocity, refusals=int(noise[1]), noise_factor=float(noise[0])
            )
            for name, pose, m, stamp, noise, velocity in zip(
                f.names,
                poses,
                measured_poses,
                f.stamps,
                f.vectors[_VECTORS::2],
                f.vectors[_VECTORS + 1 :: 2],
                strict=True,
            )
        }
        velocity, gyro, force, slip, scalars, *calibration, offsets = f.vectors[:_VECTORS]
        estimate = Estimate(
            stamp_ns=nodes[-1].stamp_ns,
            pose=unpack_poses(f.body, _FIELD)[0],
            velocity=velocity.copy(),
            biases=np.concatenate([gyro, force]),
            slip=slip.copy(),
            calibration=np.concatenate(calibration),
            covariance=f.covariance.reshape(size, size).copy(),
            cross_covariance=np.zeros((size, 9)),
            clones=clones,
            wheel_speed_m_s=float(scalars[1]),
            consecutive_refusals=int(scalars[2]),
        )
        start = UncertainTransform(unpack_poses(f.start, _FIELD)[0], _from_row(f.start_covariance[0]))
        pins = {int(t) * 1000 for t in links.pins}
        joints = _joints_from_message(message.joints)
        applied_s = {source: float(s) for source, s in zip(ODOMETRIES, offsets, strict=True) if s}
        return cls(estimate, nodes, pins, start, float(scalars[0]) or None, joints, applied_s)


def _check_sizes(message: PositionState) -> None:
    """Raise InputError if the field sizes of a message are inconsistent."""
    links, f = message.links, message.filter
    n, c = len(message.line.stamps_ns), len(f.names)
    sizes = {
        "links": (len(links.links), 9 * n),
        "covariances": (len(links.covariances), 9 * n),
        "start": (len(f.start), 1),
        "body": (len(f.body), 1),
        "vectors": (len(f.vectors), _VECTORS + 2 * c),
        "stamps": (len(f.stamps), c),
        "poses": (len(f.poses), c),
        "measured": (len(f.measured), c),
        "measuredCovariances": (len(f.measured_covariances), c),
        "covariance": (6 * len(f.covariance), (CORE_SIZE + 6 * c) ** 2),
        "startCovariance": (len(f.start_covariance), 1),
    }
    for name, (size, expected) in sizes.items():
        if size != expected:
            raise InputError(f"PositionState.{name}: size {size}, expected {expected} by the other fields")
    if not n:
        raise InputError("PositionState.line: no poses, expected at least one")


def _joints_to_message(joints: Mapping[str, JointValues]) -> PositionStateJoints:
    """Return the values of all joints as one message."""
    series = list(joints.values())
    stamps = np.concatenate([np.zeros(0, np.int64), *(j.stamps_ns for j in series)])
    gaps = np.concatenate([np.zeros(0, bool), *(np.isin(j.stamps_ns, list(j.gaps_ns)) for j in series)])
    return PositionStateJoints(
        names=tuple(joints),
        counts=np.array([len(j.values) for j in series], dtype=np.int64),
        stamps=stamps // 1000,
        values=np.concatenate([np.zeros(0), *(j.values for j in series)]),
        broken=np.flatnonzero(gaps).astype(np.int64),
    )


def _joints_from_message(message: PositionStateJoints) -> dict[str, JointValues]:
    """Return the values of the joints of a message; raises InputError if its sizes are inconsistent."""
    total = len(message.values)
    sums = np.concatenate([[0], np.cumsum(message.counts)])
    if (
        len(message.counts) != len(message.names)
        or (message.counts < 0).any()
        or sums[-1] != total
        or len(message.stamps) != total
    ):
        raise InputError(
            f"PositionState.joints: {len(message.names)} names, counts {message.counts.tolist()}, "
            f"{len(message.stamps)} stamps and {total} values are inconsistent"
        )
    stamps, gaps = message.stamps * 1000, np.isin(np.arange(total), message.broken)
    spans = [slice(int(a), int(b)) for a, b in itertools.pairwise(sums)]
    return {
        name: JointValues(stamps[at], message.values[at], set(stamps[at][gaps[at]].tolist()))
        for name, at in zip(message.names, spans, strict=True)
    }


def _to_row(covariance: FloatArray | None) -> FloatArray:
    return np.full(36, np.nan) if covariance is None else covariance.reshape(36)


def _from_row(row: FloatArray) -> FloatArray | None:
    return None if np.isnan(row).any() else row.reshape(6, 6)
