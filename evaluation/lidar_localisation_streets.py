# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate lidar_localisation on measured street scans: one scan is the map, another one the sweep.

The guess is 2 m and 20 degrees of heading off, in random directions. With halves, the points of one scan are
divided into map and sweep; the truth is exact. Maps of several sweeps contain one half of the points of each
sweep, at the poses of the data set or of ``lidar_slam``; the other half of the last one is the sweep.
Vegetation (simulated): noise of 10 cm is added to all points above the road of all clouds. The truth of
successive scans is that of the data set (centimetres, 0.1 degrees), whose error is part of the NEES
(6 expected).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance
from evaluation.data_sets.clouds import kitti_pair, small_gicp_pair
from evaluation.icp_covariance import halves
from evaluation.lidar_slam_thinned import run_lidar_slam
from evaluation.real import RealRow
from evaluation.record import squared_error
from evaluation.runs.thinned_sweeps import kitti_sweeps

#: Page that contains the table of this evaluation.
PAGE = "lidar_localisation"

TRIALS = 6
GUESS_M, GUESS_DEG = 2.0, 20.0
VEGETATION_M, ROAD_Z_M = 0.1, -1.4
#: Map, sweep and true T_map_sweep.
Street = tuple[FloatArray, FloatArray, FloatArray]


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors and NEES per street, and the answers to sweeps that are not on the map."""
    drive = [data / "kitti_velodyne" / f"{i:06d}.bin" for i in range(3)]
    first = read_kitti_bin(drive[0]).points_m.astype(np.float64)
    poses = _poses_by_lidar_slam(drive)
    clouds = [read_kitti_bin(path).points_m.astype(np.float64) for path in drive]
    sweep, street, T = kitti_pair(data)
    source, target, T_target_source = small_gicp_pair(data)
    streets: dict[str, Callable[[int], Street]] = {
        "KITTI 94, sweep 95": lambda seed: (street, sweep, T),
        "the same with vegetation": lambda seed: (*_vegetation(street, sweep, seed), T),
        "small_gicp's pair": lambda seed: (target, source, T_target_source),
        "halves of KITTI 000000": lambda seed: halves(first, seed)[:3],
        "map of KITTI 94 and 95": lambda seed: _merged([street, sweep], [np.eye(4), T], seed),
        "map of KITTI 0, 1, 2": lambda seed: _merged(clouds, poses, seed),
        "map of KITTI 0, 1, 2 with vegetation": lambda seed: _merged(
            [_rough(cloud, seed + i) for i, cloud in enumerate(clouds)], poses, seed
        ),
    }
    results = {}
    for name, make in streets.items():
        progress(f"lidar_localisation_streets: {name}")
        results[name] = _summary([_localise_from_guess(make(seed), seed) for seed in range(TRIALS)])
    elsewhere = [localise(street, first, None), localise(first, sweep, None)]
    return {
        "streets": results,
        "not_on_the_map": [list(output.quality.reasons) for output in elsewhere],
        "real": {"PointToPlane": _squared_errors(results)},
    }


def _squared_errors(results: dict[str, Any]) -> dict[str, Any]:
    """Return the figures that ``cdff check`` reads: NEES on measured sweeps without added noise.

    Each trial with halves has its own pair of clouds; the other trials differ only in the guess. Maps of
    several sweeps are left out: they too contain one half of the sweep, so there is no difference of views.
    """
    return {
        name: squared_error(
            row["mean_nees"], 6, row["localised"], row["localised"] if name.startswith("halves") else 1
        )
        for name, row in results.items()
        if row["localised"] and "with vegetation" not in name and not name.startswith("map")
    }


def localise(map_m: FloatArray, sweep_m: FloatArray, guess: FloatArray | None) -> Output:
    """Return the output for a sweep on a map, from a guess T_map_sweep or without one."""
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure({})
    samples = [Sample("map", 0, 0, Pointcloud.from_points(map_m, frame="map", stamp_ns=0))]
    if guess is not None:
        sigma = np.repeat([GUESS_M, np.radians(GUESS_DEG)], 3)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(guess, np.diag(sigma**2)), parent="map", child="lidar", stamp_ns=0
        )
        samples.append(Sample("guess", 0, 0, value))
    points = sweep_m.astype(np.float32)
    scan = LidarScan.from_arrays(points, np.zeros(len(points), np.uint32), frame="lidar", t0_ns=0, t1_ns=0)
    samples.append(Sample("scan", 0, 0, scan))
    (output,) = [output for sample in samples for output in dfpc.step(sample)]
    return output


def inaccurate_guess(T: FloatArray, seed: int) -> FloatArray:
    """Return a pose moved by 2 m in a random horizontal direction and rotated by 20 degrees about z."""
    rng = np.random.default_rng(seed)
    angle, side = rng.uniform(0.0, 2.0 * np.pi), rng.choice([-1.0, 1.0])
    R = se3.exp_so3(np.array([0.0, 0.0, side * np.radians(GUESS_DEG)])) @ T[:3, :3]
    return se3.transform(R, T[:3, 3] + GUESS_M * np.array([np.cos(angle), np.sin(angle), 0.0]))


def _poses_by_lidar_slam(paths: list[Path]) -> list[FloatArray]:
    """Return the poses of successive sweeps in the frame of the first one."""
    outputs, _ = run_lidar_slam(kitti_sweeps(paths))
    return [output.value.transform.matrix for output in outputs]


def _merged(clouds: list[FloatArray], poses: list[FloatArray], seed: int) -> Street:
    """Return a map of one half of the points of all clouds, the other half of the last one, and its pose."""
    rng = np.random.default_rng([seed, 2])
    map_m = []
    for cloud, T in zip(clouds, poses, strict=True):
        is_map = rng.random(len(cloud)) < 0.5
        map_m.append(se3.transform_points(T, cloud[is_map]))
    return np.vstack(map_m), clouds[-1][~is_map], poses[-1]


def _vegetation(map_m: FloatArray, sweep_m: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return both clouds with noise on the points above the road."""
    return _rough(map_m, 2 * seed), _rough(sweep_m, 2 * seed + 1)


def _rough(points_m: FloatArray, seed: int) -> FloatArray:
    rng = np.random.default_rng([seed, 1])
    is_above = points_m[:, 2:] > ROAD_Z_M
    return np.asarray(points_m + np.where(is_above, rng.normal(0.0, VEGETATION_M, points_m.shape), 0.0))


def _localise_from_guess(street: Street, seed: int) -> tuple[float, float, float] | None:
    """Return the error in metres and degrees and the NEES; None if the sweep is refused."""
    map_m, sweep_m, T_true = street
    output = localise(map_m, sweep_m, inaccurate_guess(T_true, seed))
    if output.value is None:
        return None
    T = output.value.transform
    error = pose_error(T_true, T.matrix)
    squared = float(error @ np.linalg.solve(T.covariance, error))
    return float(np.linalg.norm(error[:3])), float(np.degrees(np.linalg.norm(error[3:]))), squared


def _summary(rows: list[tuple[float, float, float] | None]) -> dict[str, Any]:
    answered = np.array([row for row in rows if row is not None]).reshape(-1, 3)
    summary: dict[str, Any] = {"trials": len(rows), "localised": len(answered)}
    if len(answered):
        summary |= {
            "max_error_m": round(float(answered[:, 0].max()), 4),
            "max_error_deg": round(float(answered[:, 1].max()), 3),
            "mean_nees": round(float(answered[:, 2].mean()), 2),
            "max_nees": round(float(answered[:, 2].max()), 1),
        }
    return summary


def table(figures: dict[str, Any]) -> str:
    """Return the table of the streets."""
    lines = [
        "| map and sweep | localised | largest error | mean NEES (6 expected) |",
        "|---" * 4 + "|",
    ]
    for name, row in figures["streets"].items():
        error = f"{1e3 * row['max_error_m']:.1f} mm, {row['max_error_deg']}°" if row["localised"] else "–"
        lines.append(
            f"| {name} | {row['localised']} of {row['trials']} | {error} | {row.get('mean_nees', '–')} |"
        )
    refused = sum("lost" in reasons for reasons in figures["not_on_the_map"])
    lines.append(
        f"| sweeps that are not on the map | {refused} of {len(figures['not_on_the_map'])} refused | | |"
    )
    return "\n".join(lines)


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    previous = {"the same with vegetation": "refused", "small_gicp's pair": "refused"}
    return [
        RealRow(
            f"{name}, guess 2 m and 20° off: localised, error, mean NEES (6 expected)",
            previous.get(name, ""),
            f"{row['localised']} of {row['trials']}, {1e3 * row['max_error_m']:.1f} mm, {row['mean_nees']}",
            "",
            "all, ≤ 15",
        )
        for name, row in figures["streets"].items()
    ]
