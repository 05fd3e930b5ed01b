# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation map of a log along its estimated trajectory."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Sample
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.progress import Progress
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_core.runtime import Runner
from cdff_dev.compilation import compilation_notice
from cdff_dev.logs.source import LogSource
from cdff_dev.replay.engine import samples_of
from cdff_dev.slam.estimation import Estimation

ELEVATION_DFPC = "digital_elevation_mapping"
#: Implementation whose map contains the whole traverse; it takes clouds of both sensors.
_IMPLEMENTATION = "LidarGlobal"
#: Axes of a level camera: x right, y down, z forward; of the base: x forward, y left, z up.
_T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Elevation:
    """Elevation map of a log.

    Attributes
    ----------
    map : ElevationMap
        Frame ``{robot}/start``: z up, x forward at the first pose.
    T_start_origin : ndarray, shape (4, 4)
        Pose of the frame of the trajectory in the frame of the map.
    run : dict
        Configuration and counts, for ``run.json``.
    """

    map: ElevationMap
    T_start_origin: se3.FloatArray
    run: dict[str, Any]


def map_elevation(
    estimation: Estimation, log: LogSource, resolution_m: float, profile: str | None = None
) -> Elevation:
    """Pass the samples of a log and the poses of an estimation to the elevation mapping.

    Without a profile the sensor is assumed to be level at the first pose, with the axes that are usual for
    its type: z up for a lidar, z forward and y down for a camera.

    Parameters
    ----------
    resolution_m : float
        Edge of a cell, metres.
    profile : str, optional
        Profile with the mount of the sensor and the parameters of the robot.

    Raises
    ------
    RefusedError
        If no patch could be mapped.
    """
    method = estimation.method
    stream = estimation.run["streams"][method.port]
    robot = stream.split("/")[1]
    T_base_child = _T_BASE_CAMERA if method.port == "stereo" and profile is None else np.eye(4)
    dfpc = _configure_dfpc(estimation, robot, resolution_m, profile, T_base_child)
    poses = _poses(estimation, robot, T_base_child)
    progress = Progress(log.streams[stream].count, method.unit)
    runner, patches = Runner(dfpc), list[Product]()
    for sample in heapq.merge(poses, samples_of(log, {method.port: stream}, robot), key=_stamp):
        runner.push(sample)
        patches += [product for product in runner.drain() if product.port == "map"]
        if sample.port == method.port:
            progress.advance()
    patches += [product for product in runner.finish() if product.port == "map"]
    progress.close()
    reasons = sorted({r.split(":")[0] for p in patches for r in p.header.quality.reasons})
    if all(product.header.quality.status is Status.FAILED for product in patches):
        raise RefusedError(f"no elevation map: {', '.join(reasons) or 'no patch was made'}")
    elevation: ElevationMap = dfpc.call("get_whole_map", {})
    T_start_origin = T_base_child @ se3.inverse(estimation.track.matrices[0])
    return Elevation(elevation, T_start_origin, _summary(dfpc, elevation, patches, reasons))


def _configure_dfpc(
    estimation: Estimation, robot: str, resolution_m: float, profile: str | None, T_base_child: se3.FloatArray
) -> Dfpc:
    """Return the elevation mapping, configured by the profile or, without one, with the given mount."""
    dfpc = Registry.default().make_dfpc(ELEVATION_DFPC)
    parameters: dict[str, Any] = {"resolution_m": resolution_m}
    if profile is None:
        frames = FrameGraph()
        frames.set_static(f"{robot}/base", estimation.child, UncertainTransform.exact(T_base_child))
        context = DfpcContext(robot, frames)
    else:
        of_robot = load_profile(profile).robot(robot)
        entry = next((entry for entry in of_robot.dfpcs if entry.name == ELEVATION_DFPC), None)
        context = of_robot.context(of_robot.dfpc(estimation.method.dfpc) if entry is None else entry)
        parameters |= {} if entry is None else dict(entry.parameters)
    with compilation_notice(dfpc.name):
        dfpc.configure(parameters, context, _IMPLEMENTATION)
    return dfpc


def _poses(estimation: Estimation, robot: str, T_base_child: se3.FloatArray) -> Iterator[Sample]:
    """Yield the poses of the base relative to its first pose."""
    track = estimation.track
    assert track.covariances is not None
    to_base = UncertainTransform.exact(T_base_child)
    to_child = UncertainTransform.exact(se3.inverse(T_base_child))
    T_start = se3.inverse(track.matrices[0]) @ track.matrices
    for seq, stamp_ns in enumerate(track.stamps_ns.tolist()):
        covariance = track.covariances[seq]
        known = covariance if np.isfinite(covariance).all() else None
        pose = to_base @ UncertainTransform(T_start[seq], known) @ to_child
        value = TransformWithCovariance.from_transform(
            pose, parent=f"{robot}/start", child=f"{robot}/base", stamp_ns=stamp_ns
        )
        yield Sample("poses", stamp_ns, seq, value)


def _stamp(sample: Sample) -> int:
    return sample.stamp_ns


def _summary(
    dfpc: Dfpc, elevation: ElevationMap, patches: list[Product], reasons: list[str]
) -> dict[str, Any]:
    """Return the summary of an elevation map for ``run.json``."""
    heights = np.asarray(elevation.layer("mean"), dtype=np.float64)
    known = heights[np.isfinite(heights)]
    geometry = elevation.geometry
    return {
        "dfpc": dfpc.name,
        "implementation": dfpc.implementation,
        "config_hash": dfpc.config_hash,
        "parameters": dfpc.config.model_dump(mode="json"),
        "patches": len(patches),
        "reasons": reasons,
        "resolution_m": geometry.resolution_m,
        "size_m": [geometry.cols * geometry.resolution_m, geometry.rows * geometry.resolution_m],
        "observed_cells": len(known),
        "height_range_m": [float(known.min()), float(known.max())] if len(known) else None,
    }
