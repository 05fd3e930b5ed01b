# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a position manager keeps over a restart, to and from its message."""

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
from cdff_core.dfpcs.position_manager.estimate import CORE, Clone, Estimate
from cdff_core.dfpcs.position_manager.frames import JointValues
from cdff_core.dfpcs.position_manager.time_line import Node, TimeLine

_WHERE = "PositionState"


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """Newest estimate, nodes and pins of the line, ``T_odom_base`` of the start, gravity (m/s^2), joints."""

    estimate: Estimate
    nodes: list[Node]
    pins: set[int]
    start: UncertainTransform
    gravity_m_s2: float | None
    joints: dict[str, JointValues]


def to_message(
    line: TimeLine,
    estimate: Estimate,
    start: UncertainTransform,
    gravity_m_s2: float | None,
    joints: Mapping[str, JointValues],
    base: str,
    producer: str,
) -> PositionState:
    """The message; times that are no multiples of a microsecond are rounded down to one."""
    nodes = line.nodes
    stamps = np.array([n.stamp_ns for n in nodes]) // 1000
    trajectory = PoseTrajectory.from_arrays(
        stamps * 1000, np.array([n.pose for n in nodes]), parent="site", child=base, producer=producer
    )
    links = PositionStateLinks(
        np.concatenate([n.covariance for n in nodes]),
        np.concatenate([n.link for n in nodes]),
        np.array(sorted(line.pins), dtype=np.int64) // 1000,
        stamps[[n.broken for n in nodes]],
    )
    clones = list(estimate.clones.values())
    vectors = [estimate.velocity, *estimate.biases.reshape(2, 3), estimate.slip, [gravity_m_s2 or 0.0, 0.0, 0.0]]
    unknown = np.full(36, np.nan)
    filtered = PositionStateFilter(
        start=pack_poses(start.matrix[None], _WHERE),
        start_covariance=_rows(start.covariance, unknown)[None],
        body=pack_poses(estimate.pose[None], _WHERE),
        vectors=np.array(vectors),
        names=tuple(estimate.clones),
        stamps=np.array([c.stamp_ns // 1000 for c in clones], dtype=np.int64),
        poses=pack_poses(np.array([c.pose for c in clones]), _WHERE),
        measured=pack_poses(np.array([c.measured.matrix for c in clones]), _WHERE),
        measured_covariances=np.array([_rows(c.measured.covariance, unknown) for c in clones]).reshape(-1, 36),
        covariance=estimate.covariance.reshape(-1, 6),
    )
    metadata = PositionStateMetadata(producer_id=producer)
    return PositionState(metadata, trajectory, links, filtered, _joints_message(joints))


def from_message(message: PositionState) -> Kept:
    """What the message holds; raises InputError where its parts do not fit together."""
    line, links, f = message.line, message.links, message.filter
    n, c = len(line.stamps_ns), len(f.names)
    errors = CORE + 6 * c
    parts = {
        "links": (len(links.links), 9 * n), "covariances": (len(links.covariances), 9 * n), "start": (len(f.start), 1),
        "body": (len(f.body), 1), "vectors": (len(f.vectors), 5), "stamps": (len(f.stamps), c),
        "poses": (len(f.poses), c), "measured": (len(f.measured), c),
        "measuredCovariances": (len(f.measured_covariances), c), "covariance": (6 * len(f.covariance), errors**2),
        "startCovariance": (len(f.start_covariance), 1),
    }  # fmt: skip
    wrong = next((name for name, (has, expected) in parts.items() if has != expected), None)
    if wrong is not None or not n:
        has = n if wrong is None else parts[wrong][0]
        raise InputError(f"PositionState.{wrong or 'line'}: {has} rows do not fit the rest")
    covariances, chain = links.covariances.reshape(n, 9, 9), links.links.reshape(n, 9, 9)
    broken = set(links.broken.tolist())
    nodes = [
        Node(int(t), T, C, X, int(t) // 1000 in broken)
        for t, T, C, X in zip(line.stamps_ns, line.matrices, covariances, chain, strict=True)
    ]
    measured = zip(unpack_poses(f.measured, _WHERE), f.measured_covariances, strict=True)
    clones = {
        name: Clone(pose, UncertainTransform(T, _square(C)), int(stamp) * 1000)
        for name, pose, (T, C), stamp in zip(f.names, unpack_poses(f.poses, _WHERE), measured, f.stamps, strict=True)
    }
    velocity, gyro, force, slip, gravity = f.vectors
    estimate = Estimate(
        nodes[-1].stamp_ns,
        unpack_poses(f.body, _WHERE)[0],
        velocity.copy(),
        np.concatenate([gyro, force]),
        slip.copy(),
        f.covariance.reshape(errors, errors).copy(),
        np.zeros((errors, 9)),
        clones,
    )
    start = UncertainTransform(unpack_poses(f.start, _WHERE)[0], _square(f.start_covariance[0]))
    pins = {int(t) * 1000 for t in links.pins}
    return Kept(estimate, nodes, pins, start, float(gravity[0]) or None, _joints(message.joints))


def _joints_message(joints: Mapping[str, JointValues]) -> PositionStateJoints:
    kept = list(joints.values())
    stamps = np.concatenate([np.zeros(0, np.int64), *(j.stamps_ns for j in kept)])
    broken = np.concatenate([np.zeros(0, bool), *(np.isin(j.stamps_ns, list(j.broken_ns)) for j in kept)])
    return PositionStateJoints(
        names=tuple(joints),
        counts=np.array([len(j.values) for j in kept], dtype=np.int64),
        stamps=stamps // 1000,
        values=np.concatenate([np.zeros(0), *(j.values for j in kept)]),
        broken=np.flatnonzero(broken).astype(np.int64),
    )


def _joints(message: PositionStateJoints) -> dict[str, JointValues]:
    total = len(message.values)
    sums = np.concatenate([[0], np.cumsum(message.counts)])
    if (
        len(message.counts) != len(message.names)
        or (message.counts < 0).any()
        or sums[-1] != total
        or len(message.stamps) != total
    ):
        raise InputError(
            f"PositionState.joints: {len(message.names)} names, {message.counts.tolist()} values of each, "
            f"{len(message.stamps)} stamps and {total} values do not fit together"
        )
    stamps, broken = message.stamps * 1000, np.isin(np.arange(total), message.broken)
    spans = [slice(int(a), int(b)) for a, b in itertools.pairwise(sums)]
    return {
        name: JointValues(stamps[at], message.values[at], set(stamps[at][broken[at]].tolist()))
        for name, at in zip(message.names, spans, strict=True)
    }


def _rows(covariance: FloatArray | None, unknown: FloatArray) -> FloatArray:
    return unknown if covariance is None else covariance.reshape(36)


def _square(row: FloatArray) -> FloatArray | None:
    return None if np.isnan(row).any() else row.reshape(6, 6)
