# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Adjustment of keyframes and their common points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import BundleProblem
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs, BundleOptimizationOutputs
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframe, VisualKeyframeMap

AdjustmentDfn = Dfn[Any, BundleOptimizationInputs, BundleOptimizationOutputs]
#: Number of common points below which a keyframe is not adjusted.
_MIN_OBSERVATIONS = 12


def adjust(
    keyframes: VisualKeyframeMap,
    free: Sequence[int],
    fixed: Sequence[int],
    optimise: AdjustmentDfn,
    sigma_px: float,
) -> bool:
    """Adjust the poses of some keyframes with their common points; return whether that was possible.

    The unit of the residuals is the standard deviation of a feature. The depth of a point enters as the
    column in a second image, at the distance that gives it the stated standard deviation.
    """
    keys = [*free, *fixed]
    camera, point, rows = _tracks(keyframes, keys)
    counts = np.bincount(camera, minlength=len(keys))
    usable = counts >= _MIN_OBSERVATIONS
    if not usable[: len(free)].any() or not fixed:
        return False
    is_kept = usable[camera]
    camera, rows = camera[is_kept], rows[is_kept]
    _, point, observation_counts = np.unique(point[is_kept], return_inverse=True, return_counts=True)
    is_repeated = observation_counts[point] > 1
    camera, rows, point = (
        camera[is_repeated],
        rows[is_repeated],
        np.unique(point[is_repeated], return_inverse=True)[1],
    )
    cameras, camera = np.unique(camera, return_inverse=True)
    adjusted_keys = [keys[c] for c in cameras]
    is_fixed = cameras >= len(free)
    if is_fixed.all() or not is_fixed.any():
        return False
    positions = np.concatenate(
        [keyframes.keyframes[k].points.positions_m[rows[camera == i]] for i, k in enumerate(adjusted_keys)]
    )
    sigmas = np.concatenate(
        [keyframes.keyframes[k].points.depth_sigmas_m[rows[camera == i]] for i, k in enumerate(adjusted_keys)]
    )
    order = np.concatenate([np.flatnonzero(camera == i) for i in range(len(adjusted_keys))])
    camera, point = camera[order], point[order]
    T = np.array([keyframes.poses[k] for k in adjusted_keys])
    lenses = np.array([_lens(keyframes.keyframes[k], sigma_px) for k in adjusted_keys])
    problem = BundleProblem.from_arrays(
        T,
        lenses,
        _initial_points(T, camera, point, positions, sigmas),
        (camera, point),
        _pixels(positions, lenses[camera]),
        frame="map",
        lens_of_camera=np.arange(len(adjusted_keys)),
        fixed=np.where(is_fixed, 1, 0),
    )
    adjusted = optimise.process(BundleOptimizationInputs(problem=problem)).problem.cameras.matrices
    poses = {k: T for k, T, constant in zip(adjusted_keys, adjusted, is_fixed, strict=True) if not constant}
    keyframes.adjust(poses, [k for k, constant in zip(adjusted_keys, is_fixed, strict=True) if constant])
    return True


def _tracks(keyframes: VisualKeyframeMap, keys: Sequence[int]) -> tuple[IntArray, IntArray, IntArray]:
    """Return for each observation the index of its keyframe, the number of its point and its row.

    Linked rows are observations of one point; points that a keyframe would observe twice are omitted.
    """
    index = {key: i for i, key in enumerate(keys)}
    sizes = np.array([len(keyframes.keyframes[key].points) for key in keys])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    pairs = [
        rows + starts[[index[a], index[b]]]
        for (a, b), rows in keyframes.links.items()
        if a in index and b in index
    ]
    if not pairs:
        none = np.zeros(0, np.int64)
        return none, none, none
    pair_nodes = np.concatenate(pairs)
    n = int(starts[-1])
    graph = coo_matrix((np.ones(len(pair_nodes), bool), (pair_nodes[:, 0], pair_nodes[:, 1])), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    nodes = np.unique(pair_nodes)
    points = np.unique(labels[nodes], return_inverse=True)[1]
    cameras = np.searchsorted(starts, nodes, side="right") - 1
    observed = np.unique(np.column_stack([points, cameras]), axis=0, return_inverse=True, return_counts=True)
    is_twice = observed[2][observed[1].ravel()] > 1
    bad = np.zeros(int(points.max()) + 1, bool)
    bad[points[is_twice]] = True
    usable = ~bad[points]
    return cameras[usable], points[usable], (nodes - starts[cameras])[usable]


def _lens(keyframe: VisualKeyframe, sigma_px: float) -> FloatArray:
    """Return fx fy cx cy, five zeros and the baseline, in units of the standard deviation of a feature."""
    focal = keyframe.focal_px / sigma_px
    z = keyframe.points.positions_m[:, 2]
    # The standard deviation of 1 / z is that of the second column, 1, by focal length and baseline.
    sigma = float(np.median(keyframe.points.depth_sigmas_m / z**2))
    lens = np.zeros(10)
    lens[:2], lens[9] = focal, 1.0 / (focal * sigma)
    return lens


def _pixels(positions: FloatArray, lenses: FloatArray) -> FloatArray:
    focal, baselines = lenses[:, 0], lenses[:, 9]
    columns, rows = (focal * positions[:, i] / positions[:, 2] for i in (0, 1))
    return np.column_stack([columns, rows, columns - focal * baselines / positions[:, 2]])


def _initial_points(
    T_map_camera: FloatArray, camera: IntArray, point: IntArray, positions: FloatArray, sigmas: FloatArray
) -> FloatArray:
    """Return the mean (p, 3) of the measured positions, weighted by their depths' information."""
    in_map = np.einsum("nij,nj->ni", T_map_camera[camera, :3, :3], positions) + T_map_camera[camera, :3, 3]
    weights, count = sigmas**-2.0, int(point.max()) + 1
    total = np.bincount(point, weights, count)
    sums = np.column_stack([np.bincount(point, weights * in_map[:, i], count) for i in range(3)])
    return np.asarray(sums / total[:, None])


def window(keyframes: VisualKeyframeMap, key: int, size: int) -> tuple[list[int], list[int]]:
    """Return a keyframe with its neighbours, and the fixed keyframes with points in common with them.

    Without fixed ones the neighbour with the smallest id is fixed.
    """
    free = [key, *keyframes.neighbours(key, size - 1)]
    shared: dict[int, int] = {}
    for k in free:
        for other, count in keyframes.linked_with(k).items():
            if other not in free:
                shared[other] = shared.get(other, 0) + count
    fixed = sorted(shared, key=lambda k: (-shared[k], k))[: 2 * size]
    if keyframes.root in free:
        free.remove(keyframes.root)
        fixed.append(keyframes.root)
    if not fixed:
        oldest = min(free)
        free.remove(oldest)
        fixed.append(oldest)
    return free, fixed


def relative_motion(T_before: FloatArray, T_after: FloatArray) -> tuple[float, float]:
    """Return the distance and the angle between two transforms, metres and radians."""
    T = se3.inverse(T_before) @ T_after
    return float(np.linalg.norm(T[:3, 3])), float(se3.rotation_angle(T[:3, :3]))
