# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wrong images and cameras for the DFPCs that use stereo pairs or image pairs.

The truth of the measured stereo pairs is: for Middlebury's Teddy the measured disparity (with an assumed
camera), for KITTI the depth from the unchanged pair, for visual odometry and relative poses the reference
of the data set. Errors of clouds and maps are 90 % quantiles in stated standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import (
    DoubleSequence,
    ElevationMap,
    Frame,
    FramePair,
    Pointcloud,
    TransformWithCovariance,
)
from evaluation.data_sets import image_pairs, kitti
from evaluation.runs.wrong_input import Case, field_error_sigmas, last_value, pose_error_sigmas

TEDDY, KITTI = "Middlebury Teddy", "KITTI 06"
#: Assumed camera of Teddy: focal length in pixels, baseline in metres.
_TEDDY_FOCAL_PX, _TEDDY_BASELINE_M = 1000.0, 0.16
#: Number of pairs for visual odometry.
_PAIRS = 10
_STEP_NS = 100_000_000
#: ``T_base_camera``: the camera looks along x, its rows are horizontal, 1.65 m above the ground.
_T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.0, 0.0, 1.65])


@dataclass(frozen=True, slots=True, eq=False)
class Stereo:
    """One stereo pair with its camera."""

    left: Any
    right: Any
    K: FloatArray
    baseline_m: float

    def message(self, stamp_ns: int, sensor: str = "robot/navcam_left") -> FramePair:
        """Return the pair as a message."""
        return FramePair.from_images(
            np.ascontiguousarray(self.left),
            np.ascontiguousarray(self.right),
            baseline_m=self.baseline_m,
            camera_matrix=self.K,
            stamp_ns=stamp_ns,
            sensor=sensor,
            T_robot_sensor=UncertainTransform.exact(_T_BASE_CAMERA),
        )


Fault = Callable[[Stereo], Stereo]


def _lower_rows(offset_px: float) -> Fault:
    warp = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, offset_px]])
    return lambda s: replace(
        s,
        right=cv2.warpAffine(
            s.right, warp, s.right.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        ),
    )


def _focal(ratio: float) -> Fault:
    return lambda s: replace(s, K=s.K * np.array([[ratio, 1.0, 1.0], [1.0, ratio, 1.0], [1.0, 1.0, 1.0]]))


FAULTS: dict[str, Fault] = {
    "none": lambda s: s,
    "empty images": lambda s: replace(s, left=s.left[:0], right=s.right[:0]),
    "both black": lambda s: replace(s, left=0 * s.left, right=0 * s.right),
    "both white": lambda s: replace(s, left=np.full_like(s.left, 255), right=np.full_like(s.right, 255)),
    "right uniform": lambda s: replace(s, right=np.full_like(s.right, 128)),
    "right equal to left": lambda s: replace(s, right=s.left),
    "left and right exchanged": lambda s: replace(s, left=s.right, right=s.left),
    **{f"right image {px:g} px lower": _lower_rows(px) for px in (0.5, 1.0, 2.0)},
    **{f"focal length {p} % too long": _focal(1.0 + p / 100.0) for p in (1, 3)},
    "camera matrix NaN": lambda s: replace(s, K=np.full((3, 3), np.nan)),
    "baseline 0": lambda s: replace(s, baseline_m=0.0),
    "baseline NaN": lambda s: replace(s, baseline_m=float("nan")),
}
LATE = "right camera one pair late"
#: Faults that are wrong for two images without stereo calibration.
_OF_MATCHING = [name for name in FAULTS if "lower" not in name and "baseline" not in name]


def cases(data: Path) -> Iterator[Case]:
    """Yield the cases of all DFPCs that use images."""
    pairs, truth = kitti.read(data / kitti.SEQUENCE)
    start = kitti.measured_from(truth)
    pairs, truth = pairs[start : start + _PAIRS], se3.inverse(truth[start]) @ truth[start : start + _PAIRS]
    drive = [
        Stereo(np.array(p.left.image), np.array(p.right.image), np.array(p.camera_matrix), p.baseline)
        for p in pairs
    ]
    late = [replace(b, right=a.right) for a, b in pairwise(drive)]
    teddy, teddy_depth_m = _teddy(data)
    kitti_depth_m = _depth_of(drive[1])
    street_map = last_value(
        "digital_elevation_mapping", _elevation_samples(drive[1]), DfpcContext("robot"), "map", "Stereo"
    )
    for fault, change in FAULTS.items():
        yield _triangulation(TEDDY, fault, change(teddy), teddy_depth_m)
        yield _triangulation(KITTI, fault, change(drive[1]), kitti_depth_m)
        yield _elevation(fault, change(drive[1]), street_map)
        if fault in _OF_MATCHING:
            yield _matching(fault, change(drive[1]), _baseline(1.0))
        yield _odometry(fault, [change(s) for s in drive], truth)
    yield _triangulation(KITTI, LATE, late[0], kitti_depth_m)
    yield _elevation(LATE, late[0], street_map)
    yield _matching(LATE, late[0], se3.inverse(truth[1]) @ truth[0] @ _baseline(drive[0].baseline_m))
    yield _odometry(LATE, late, se3.inverse(truth[1]) @ truth[1:])


def _baseline(length_m: float) -> FloatArray:
    return se3.transform(np.eye(3), np.array([length_m, 0.0, 0.0]))


def _teddy(data: Path) -> tuple[Stereo, FloatArray]:
    """Return the pair with an assumed camera, and its depth image; NaN where it is unknown."""
    pair = image_pairs.middlebury(data, "teddy")
    disparity = image_pairs.grey(data / "middlebury" / "teddy" / "disp2.png").astype(np.float64) / 4.0
    rows, columns = disparity.shape
    K = np.array([[_TEDDY_FOCAL_PX, 0, columns / 2], [0, _TEDDY_FOCAL_PX, rows / 2], [0, 0, 1.0]])
    with np.errstate(divide="ignore"):
        depth_m = np.where(disparity > 0, _TEDDY_FOCAL_PX * _TEDDY_BASELINE_M / disparity, np.nan)
    return Stereo(pair.left, pair.right, K, _TEDDY_BASELINE_M), depth_m


def _triangulate(stereo: Stereo) -> tuple[Pointcloud, DoubleSequence]:
    dfpc = Registry.default().make_dfpc("triangulation")
    dfpc.configure({"max_points": 400_000})
    (output,) = dfpc.step(Sample("stereo", 0, 0, stereo.message(0)))
    return output.value, dfpc.store.get("depth_sigmas")


def _depth_of(stereo: Stereo) -> FloatArray:
    """Return the depth image from the cloud of a pair; NaN where there is no point."""
    cloud, _ = _triangulate(stereo)
    depth_m = np.full(stereo.left.shape, np.nan)
    rows, columns = _pixels(cloud.points_m, stereo.K)
    depth_m[rows, columns] = cloud.points_m[:, 2]
    return depth_m


def _pixels(points_m: FloatArray, K: FloatArray) -> tuple[Any, Any]:
    columns = np.rint(points_m[:, 0] / points_m[:, 2] * K[0, 0] + K[0, 2]).astype(int)
    rows = np.rint(points_m[:, 1] / points_m[:, 2] * K[1, 1] + K[1, 2]).astype(int)
    return rows, columns


def _triangulation(data: str, fault: str, stereo: Stereo, depth_m: FloatArray) -> Case:
    def error(cloud: Pointcloud) -> float:
        all_points, sigmas = _triangulate(stereo)
        rows, columns = _pixels(all_points.points_m, stereo.K)
        return field_error_sigmas(all_points.points_m[:, 2] - depth_m[rows, columns], sigmas.values)

    def samples() -> list[Sample]:
        return [Sample("stereo", 0, 0, stereo.message(0))]

    return Case("triangulation", data, fault, "cloud", samples, error)


def _elevation_samples(stereo: Stereo) -> list[Sample]:
    T = UncertainTransform(np.eye(4), np.diag([1e-4] * 3 + [1e-6] * 3))
    poses = [
        Sample(
            "poses",
            stamp_ns,
            i,
            TransformWithCovariance.from_transform(T, parent="site", child="robot/base", stamp_ns=stamp_ns),
        )
        for i, stamp_ns in enumerate((0, 2 * _STEP_NS))
    ]
    return [poses[0], Sample("stereo", _STEP_NS, 0, stereo.message(_STEP_NS)), poses[1]]


def _elevation(fault: str, stereo: Stereo, truth: ElevationMap) -> Case:
    def error(value: ElevationMap) -> float:
        (heights, sigmas), (true_heights, _) = _on_common_cells(value, truth)
        return field_error_sigmas(heights - true_heights, sigmas)

    return Case(
        "digital_elevation_mapping",
        KITTI,
        fault,
        "map",
        lambda: _elevation_samples(stereo),
        error,
        implementation="Stereo",
    )


def _on_common_cells(a: ElevationMap, b: ElevationMap) -> list[tuple[FloatArray, FloatArray]]:
    """Return mean and standard deviation of two maps of one grid, with the cells of the first one."""
    rows, columns = np.indices(a.geometry.shape)
    geometry_a, geometry_b = a.geometry, b.geometry
    rows_of_b = rows + round((geometry_b.ymax_m - geometry_a.ymax_m) / geometry_a.resolution_m)
    columns_of_b = columns + round((geometry_a.xmin_m - geometry_b.xmin_m) / geometry_a.resolution_m)
    inside = (
        (rows_of_b >= 0)
        & (rows_of_b < geometry_b.rows)
        & (columns_of_b >= 0)
        & (columns_of_b < geometry_b.cols)
    )
    cells = [(a, rows[inside], columns[inside]), (b, rows_of_b[inside], columns_of_b[inside])]
    return [
        (m.layer("mean")[i, j].astype(np.float64), np.sqrt(m.layer("variance")[i, j].astype(np.float64)))
        for m, i, j in cells
    ]


def _matching(fault: str, stereo: Stereo, T_true: FloatArray) -> Case:
    """Return the case of two images; ``T_true`` is the pose of the right camera, of any length."""

    def samples() -> list[Sample]:
        images = {"left": stereo.left, "right": stereo.right}
        return [
            Sample(
                port,
                0,
                0,
                Frame.from_image(np.ascontiguousarray(image), stamp_ns=0, camera_matrix=stereo.K),
            )
            for port, image in images.items()
        ]

    T_true = se3.inverse(T_true) if fault == "left and right exchanged" else T_true.copy()
    T_true[:3, 3] /= np.linalg.norm(T_true[:3, 3])

    def error(value: TransformWithCovariance) -> float:
        """Return the largest error over the axes of the covariance; the length of the translation is 1."""
        T = value.transform
        assert T.covariance is not None
        variances, axes = np.linalg.eigh(T.covariance)
        return float(
            (np.abs(axes.T @ pose_error(T_true, T.matrix)) / np.sqrt(variances.clip(1e-12)))[1:].max()
        )

    return Case("feature_matching", KITTI, fault, "transform", samples, error)


def _odometry(fault: str, drive: list[Stereo], truth: FloatArray) -> Case:
    def samples() -> list[Sample]:
        return [Sample("stereo", i * _STEP_NS, i, s.message(i * _STEP_NS)) for i, s in enumerate(drive)]

    return Case(
        "visual_odometry_sparse", KITTI, fault, "pose", samples, pose_error_sigmas(truth[len(drive) - 1])
    )
