# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map of the points that a stereo camera sees along its estimated trajectory."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CdffError, InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.progress import counted
from cdff_common.types import FramePair
from cdff_core.dfns.disparity_image.interface import Inputs as DisparityInputs
from cdff_core.dfns.disparity_to_point_cloud.interface import Inputs as TriangulationInputs
from cdff_dev.logs.source import LogSource
from cdff_dev.slam.estimation import Estimation
from cdff_dev.slam.voxel_means import VoxelMeans

logger = logging.getLogger(__name__)

#: Edge of a voxel and distance between the pairs used, as shares of the median distance of the first points.
_VOXEL_SHARE, _STEP_SHARE = 0.01, 0.4
#: Rotation after which the next pair is used, radians.
_STEP_RAD = float(np.radians(15.0))


@dataclass(frozen=True, slots=True, eq=False)
class StereoMap:
    """Points of the stereo pairs of a log, one a voxel, in the frame of the first pose.

    Attributes
    ----------
    points_m : ndarray, shape (n, 3)
    grey : ndarray of uint8, shape (n,)
    run : dict
        Numbers and sizes, for ``run.json``.
    """

    points_m: NDArray[np.float64]
    grey: NDArray[np.uint8]
    run: dict[str, Any]


def map_stereo(estimation: Estimation, log: LogSource, profile: str | None = None) -> StereoMap | None:
    """Return the points of the pairs along a trajectory, as disparities, points, and one mean point a voxel.

    The first pair is used, and each pair after a motion of 0.4 of the median distance of its points, or
    of 15 degrees. Pairs without points are counted. The map is None if no pair has points.

    Parameters
    ----------
    profile : str, optional
        Profile with the mount of the camera.

    Raises
    ------
    FrameNotFoundError
        If the trajectory is that of the base, and the profile has no mount of the camera.
    """
    stereo, refused, used_count = _StereoPoints(), Counter[str](), 0
    voxels: VoxelMeans | None = None
    T_used: se3.FloatArray | None = None
    step_m = 0.0
    for T, pair in _located_pairs(estimation, log, profile):
        if T_used is not None and not _has_moved(T_used, T, step_m):
            continue
        try:
            points_m, grey = stereo.of(pair)
        except CdffError as error:
            refused[str(error)] += 1
            continue
        if voxels is None:
            distance_m = float(np.median(points_m[:, 2]))
            voxels, step_m = VoxelMeans(_VOXEL_SHARE * distance_m), _STEP_SHARE * distance_m
        voxels.add(se3.transform_points(T, points_m), grey)
        T_used, used_count = T, used_count + 1
    for reason, count in refused.items():
        logger.warning("map without %d pairs: %s", count, reason)
    if voxels is None:
        return None
    points_m, grey = voxels.means()
    run = {
        "pairs": used_count,
        "refused_pairs": refused.total(),
        "points": len(points_m),
        "voxel_m": voxels.edge_m,
    }
    return StereoMap(points_m, np.clip(np.rint(grey), 0, 255).astype(np.uint8), run)


class _StereoPoints:
    """Computes the points of a pair with the DFNs of the elevation mapping."""

    def __init__(self) -> None:
        registry = Registry.default()
        self._disparity: Any = registry.make_dfn("disparity_image")
        self._triangulation: Any = registry.make_dfn("disparity_to_point_cloud")
        for node in (self._disparity, self._triangulation):
            node.configure({})

    def of(self, pair: FramePair) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points in the frame of the left camera and their grey values; raises InputError without."""
        disparity = self._disparity.process(DisparityInputs(left=pair.left, right=pair.right)).disparity
        cloud = self._triangulation.process(
            TriangulationInputs(disparity=disparity, baseline_m=pair.baseline, left=pair.left)
        )
        if not len(cloud.points):
            raise InputError("no points: the images have no reliable disparities")
        is_16_bit = pair.left.image.dtype.itemsize > 1
        return cloud.points, cloud.intensity / (257.0 if is_16_bit else 1.0)


def _located_pairs(
    estimation: Estimation, log: LogSource, profile: str | None
) -> Iterator[tuple[se3.FloatArray, FramePair]]:
    """Yield the pairs with a pose, and the poses of their left cameras in the frame of the first pose."""
    method, track = estimation.method, estimation.track
    stream = estimation.run["streams"][method.port]
    T_first = se3.inverse(track.matrices[0])
    pose_of = dict(zip(track.stamps_ns.tolist(), track.matrices, strict=True))
    frames = None if profile is None else load_profile(profile).robot(stream.split("/")[1]).frame_graph()
    for sample in counted(log.samples([stream]), log.streams[stream].count, f"{method.unit} of the map"):
        if (T := pose_of.get(sample.stamp_ns)) is None:
            continue
        camera = sample.value.left.frame
        if frames is not None and camera != estimation.child:
            T = T @ frames.lookup(estimation.child, camera, sample.stamp_ns).matrix
        yield T_first @ T, sample.value


def _has_moved(T_a: se3.FloatArray, T_b: se3.FloatArray, step_m: float) -> bool:
    T = se3.inverse(T_a) @ T_b
    return bool(np.linalg.norm(T[:3, 3]) >= step_m or se3.rotation_angle(T[:3, :3]) >= _STEP_RAD)
