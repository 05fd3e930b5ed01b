# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation against true terrain (simulated), and a real road against its camera's height.

The simulated part maps the log of ``rover_traverse`` with its true poses, and with those that ``position_manager``
makes of its wheels, IMU and images; then drives of the same scenario on other seeds (``_dem_drives``).

References
----------
.. [1] Höhle, J., Höhle, M. (2009). Accuracy assessment of digital elevation models by means of robust statistical
   methods. ISPRS Journal 64(4). doi:10.1016/j.isprsjprs.2009.02.003 (NMAD, quantiles).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import FramePair, TransformWithCovariance
from cdff_dev.elevation import compare
from cdff_dev.evaluate._chart import Bar, Panel, chart
from cdff_dev.evaluate._dem_drives import CONFIG, as_samples, mapped, of_drives
from cdff_dev.evaluate.traverse import SCENARIO, drives, run, visual_odometry
from cdff_dev.simulate.scenario import load_scenario

T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Scores of the three sets; the disparities have an evaluation of their own."""
    return {
        "rover_traverse (simulated), 5 cm": _simulated(progress),
        "other seeds (simulated), lidar, 5 cm": of_drives(progress),
        "kitti_stereo, true poses, 20 cm": _kitti(data / "kitti_stereo" / "KITTI_sequence_1", progress),
    }


def _simulated(progress: Callable[[str], None]) -> dict[str, Any]:
    """Both rovers' maps by lidar and by stereo, with true and with estimated poses."""
    seed, found = drives()
    scenario = load_scenario(SCENARIO)
    terrain = next(iter(found[0].log.samples(["/site/truth.terrain"]))).value
    report: dict[str, Any] = {"seed": seed}
    for drive in found:
        progress(f"dem: {drive.robot} on the simulated traverse")
        felt = drive.samples({"wheels.odometry": "odometry", "imu.sample": "imu"})
        seen = as_samples(visual_odometry(drive, 0), "visual_odometry")
        poses = {
            "true poses": drive.samples({"truth.pose": "poses"}),
            "estimated poses": as_samples(run("position_manager", drive.context, [*felt, *seen]), "poses"),
        }
        for port, stream, variant in (("scan", "lidar.scan", "Lidar"), ("stereo", "navcam.pair", "Stereo")):
            captures = drive.samples({stream: port})
            for name, given in poses.items():
                samples = sorted([*given, *captures], key=lambda s: (s.stamp_ns, s.port))
                config = {**CONFIG, "range_sigma_m": scenario.lidar.range_sigma_m}
                dem = mapped(samples, drive.context, variant, config)
                whole, own = compare(dem, terrain), compare(dem, terrain, remove_shift=True)
                report[f"{drive.robot}, {variant.lower()}, {name}"] = _rounded(
                    {**whole, "rmse_without_shift_and_tilt_m": own["rmse_m"]}
                )
        drive.log.close()
    return report


def draw(figures: dict[str, Any]) -> bytes:
    """Errors and coverage on the other seeds."""
    rows = figures["other seeds (simulated), lidar, 5 cm"]["rows"]
    names = list(rows)
    error: list[Bar | None] = [tuple(1e3 * rows[n]["rmse_m"][k] for k in ("median", "min", "p95")) for n in names]
    inside: list[Bar | None] = [tuple(100 * v for v in _around(rows[n]["within_90_percent"])) for n in names]
    return chart([
        Panel("RMSE of a drive's map, mm: median, least to 95 %", names, {"maps": error}, 40.0),
        Panel("true heights within the 90 % interval, %: mean, 95 % (grey: wanted)", names, {"maps": inside}, 100.0,
              (88.0, 92.0)),
    ])  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """The frozen run, then the other seeds, then atlaas."""
    frozen = figures["rover_traverse (simulated), 5 cm"]
    lines = [
        f"| `{SCENARIO}`, seed {frozen['seed']} | bias, mm | RMSE, mm | NMAD, mm | RMSE without shift and tilt, mm "
        "| within the 90 % interval |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in frozen.items():
        if isinstance(row, dict):
            lines.append(
                f"| {name} | {1e3 * row['bias_m']:.1f} | {1e3 * row['rmse_m']:.1f} | {1e3 * row['nmad_m']:.1f} "
                f"| {1e3 * row['rmse_without_shift_and_tilt_m']:.1f} | {100 * row['within_90_percent']:.1f} % |"
            )
    other = figures["other seeds (simulated), lidar, 5 cm"]
    lines += [
        "",
        f"| {other['drives']} drives, seeds {other['seeds'][0]} to {other['seeds'][1]} | bias, root mean square, mm "
        "| RMSE of a drive, median (95 %), mm | over that of true poses, all drives "
        "| within the 90 % interval, mean (95 % of the mean) |",
        "|---|---|---|---|---|",
    ]
    for name, row in other["rows"].items():
        mean, low, high = _around(row["within_90_percent"])
        rmse = row["rmse_m"]
        lines.append(
            f"| {name} | {1e3 * row['bias_rms_m']:.1f} | {1e3 * rmse['median']:.1f} ({1e3 * rmse['p95']:.1f}) "
            f"| {row['rmse_ratio']:.2f} | {100 * mean:.1f} % ({100 * low:.1f}–{100 * high:.1f}) |"
        )
    return "\n".join(lines)


def _around(found: dict[str, float]) -> tuple[float, float, float]:
    """Mean and its 95 % interval."""
    half = 1.96 * found["standard_error"]
    return found["mean"], found["mean"] - half, min(found["mean"] + half, 1.0)


def _kitti(folder: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Height of the left camera above the mapped road along its path; 1.65 m by the data set's description."""
    progress("dem: KITTI")
    P = np.loadtxt(folder / "calib_kitti.txt").reshape(-1, 3, 4)
    T = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    T_c0_c = np.tile(np.eye(4), (len(T), 1, 1))
    T_c0_c[:, :3, :3], T_c0_c[:, :3, 3] = se3.normalise_rotation(T[:, :, :3]), T[:, :, 3]
    T_site_base = T_BASE_CAMERA @ T_c0_c @ se3.inverse(T_BASE_CAMERA)
    frames = FrameGraph()
    frames.set_static("kitti/base", "kitti/navcam_left", UncertainTransform(T_BASE_CAMERA, np.zeros((6, 6))))

    def samples() -> Iterator[Sample]:
        for i, pose in enumerate(T_site_base):
            stamp_ns = i * 100_000_000
            left, right = (
                cv2.imread(str(folder / f"image_{s}_kitti" / f"{i:06d}.png"), cv2.IMREAD_GRAYSCALE) for s in "lr"
            )
            yield Sample("stereo", stamp_ns, i, FramePair.from_images(
                left, right, baseline_m=-P[1][0, 3] / P[1][0, 0], camera_matrix=P[0][:, :3], stamp_ns=stamp_ns,
                sensor="kitti/navcam_left",
            ))  # fmt: skip
            yield Sample("poses", stamp_ns, i, TransformWithCovariance.from_transform(
                UncertainTransform(pose), parent="site", child="kitti/base", stamp_ns=stamp_ns
            ))  # fmt: skip

    config = {"resolution_m": 0.2, "max_height_m": 1.0, "fusion": {"size_m": 150.0}}
    dem = mapped(samples(), DfpcContext("kitti", frames), "Stereo", config)
    row, col, inside = dem.geometry.cells_of(T_site_base[:, 0, 3], T_site_base[:, 1, 3])
    height_m = (T_site_base[:, 2, 3] - dem.layer("mean")[row, col])[inside]
    height_m = height_m[np.isfinite(height_m)]
    return _rounded({
        "places": len(height_m), "median_height_m": float(np.median(height_m)), "std_m": float(height_m.std())
    })  # fmt: skip


def _rounded(scores: dict[str, Any]) -> dict[str, Any]:
    return {k: round(v, 5) if isinstance(v, float) else v for k, v in scores.items()}
