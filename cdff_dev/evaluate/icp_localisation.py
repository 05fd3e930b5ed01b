# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ICP localisation against truth: two lidar pairs from identity, and Devon Island's road over 100 guesses.

Devon Island: the copy is R (original + t), noisy by 0.5 mm, point for point. Model and scene are disjoint halves of the
points, one of the original, one of the copy, so that no point has its twin. A guess is the truth with its translation
off by up to 0.5 m and its rotation by up to 10 degrees, both uniform in size and in direction.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.formats.ply import read_ply
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_dev.evaluate.record import spread

TRIALS = 100
MAX_GUESS_M, MAX_GUESS_DEG = 0.5, 10.0
LIMIT_M, LIMIT_DEG = 0.02, 0.1
#: KITTI sequence 00: velodyne to left camera, from its calibration.
T_CAMERA_LIDAR = np.array(
    [
        [4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02],
        [-7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02],
        [9.999738645903e-01, 4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Errors of the three sets."""
    progress("icp: lidar pairs")
    return {
        "kitti_velodyne 94/95, from identity": _kitti(data / "kitti_velodyne"),
        "small_gicp_pair, from identity": _small_gicp(data / "small_gicp_pair"),
        "devon_island": _devon(data / "cdff_upstream" / "PointClouds", progress),
    }


def _kitti(folder: Path) -> dict[str, Any]:
    rows = np.loadtxt(folder / "00_poses_cam0.txt")
    first, second = (np.vstack([rows[i].reshape(3, 4), [0, 0, 0, 1]]) for i in (94, 95))
    T = se3.inverse(T_CAMERA_LIDAR) @ se3.inverse(first) @ second @ T_CAMERA_LIDAR
    scans = [read_kitti_bin(folder / f"0000{i}.bin").points_m for i in (94, 95)]
    return _error(_localise(scene=scans[0], model=scans[1]), T)


def _small_gicp(folder: Path) -> dict[str, Any]:
    T = np.loadtxt(folder / "T_target_source.txt")
    target, source = (read_ply(folder / f"{name}.ply").points_m for name in ("target", "source"))
    return _error(_localise(scene=target, model=source), T)


def _devon(folder: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    original = read_ply(folder / "DevonIslandRoad1.ply").points_m
    copy = read_ply(folder / "DevonIslandRoad1TransformedNoise.ply").points_m
    numbers = np.loadtxt(folder / "CloudsTransform.txt")
    R = se3.matrix_from_quaternion_xyzw(numbers[3:])
    T = se3.transform(R, R @ numbers[:3])
    good, wrong, failed, metres, degrees = 0, 0, 0, [], []
    for seed in range(TRIALS):
        progress(f"icp: Devon Island, seed {seed}")
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(original))
        half = len(order) // 2
        found = _localise(scene=copy[order[half:]], model=original[order[:half]], guess=_off(T, rng))
        if found.quality.status is Status.FAILED:
            failed += 1
            continue
        error = _error(found, T)
        metres.append(error["translation_m"])
        degrees.append(error["rotation_deg"])
        fits = error["translation_m"] <= LIMIT_M and error["rotation_deg"] <= LIMIT_DEG
        good, wrong = good + fits, wrong + (not fits)
    return {
        "seeds": [0, TRIALS - 1], "within_2_cm_and_0.1_deg": good, "failed": failed, "wrong": wrong,
        "translation_m": spread(metres), "rotation_deg": spread(degrees),
    }  # fmt: skip


def _off(T: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The truth with translation and rotation off, each uniform in size and in direction."""
    direction, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    R = se3.exp_so3(axis * np.deg2rad(rng.uniform(0, MAX_GUESS_DEG))) @ T[:3, :3]
    return se3.transform(R, T[:3, 3] + direction * rng.uniform(0, MAX_GUESS_M))


def _localise(scene: FloatArray, model: FloatArray, guess: FloatArray | None = None) -> Output:
    dfpc = Registry.default().make_dfpc("icp_localisation")
    dfpc.configure()
    samples = [
        Sample(n, 0, 0, Pointcloud.from_points(p, frame=n, stamp_ns=0)) for n, p in (("model", model), ("scene", scene))
    ]
    if guess is not None:
        value = TransformWithCovariance.from_transform(
            UncertainTransform(guess), parent="scene", child="model", stamp_ns=0
        )
        samples.insert(0, Sample("guess", 0, 0, value))
    (output,) = [output for sample in samples for output in dfpc.step(sample)]
    return output


def _error(output: Output, T_true: FloatArray) -> dict[str, Any]:
    if output.quality.status is Status.FAILED:
        return {"status": "FAILED", "reasons": list(output.quality.reasons)}
    E = se3.inverse(T_true) @ output.value.transform.matrix
    return {
        "status": str(output.quality.status),
        "translation_m": round(float(np.linalg.norm(E[:3, 3])), 5),
        "rotation_deg": round(float(np.degrees(se3.rotation_angle(E[:3, :3]))), 5),
    }
