# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare elevation maps with the true terrain (simulated), and with the camera height on a real road.

The simulated part maps the log of ``rover_traverse`` with its true poses, and with poses that
``position_manager`` estimates from wheels, IMU and images. It then maps drives of the same scenario with
other seeds (``runs/elevation.py``).

References
----------
.. [1] Höhle, J., Höhle, M. (2009). Accuracy assessment of digital elevation models by means of robust
   statistical methods. ISPRS Journal 64(4). doi:10.1016/j.isprsjprs.2009.02.003 (NMAD, quantiles).
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
from cdff_dev.compare.elevation import compare
from cdff_dev.simulate.scenario import load_scenario
from evaluation.chart import Bar, Panel, chart
from evaluation.runs.elevation import CONFIG, as_samples, build_map, evaluate_drives
from evaluation.runs.traverse import EXACT_MOUNTS, SCENARIO, run, traverse_runs, visual_odometry

T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results on the three data sets; ``disparity_image`` evaluates the disparities."""
    return {
        "rover_traverse (simulated), 5 cm": _simulated(progress),
        "other seeds (simulated), lidar, 5 cm": evaluate_drives(progress),
        "kitti_stereo, true poses, 20 cm": _kitti(data / "kitti_stereo" / "KITTI_sequence_1", progress),
    }


def _simulated(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors of the maps of both rovers by lidar and stereo, with true and estimated poses."""
    seed, drives = traverse_runs()
    scenario = load_scenario(SCENARIO)
    terrain = next(iter(drives[0].log.samples(["/site/truth.terrain"]))).value
    report: dict[str, Any] = {"seed": seed}
    for drive in drives:
        progress(f"dem: {drive.robot} on the simulated traverse")
        measured = drive.samples({"wheels.odometry": "odometry", "imu.sample": "imu"})
        vo_samples = as_samples(visual_odometry(drive, 0), "visual_odometry")
        poses = {
            "true poses": drive.samples({"truth.pose": "poses"}),
            "estimated poses": as_samples(
                run("position_manager", drive.context, [*measured, *vo_samples], parameters=EXACT_MOUNTS),
                "poses",
            ),
        }
        for port, stream, variant in (("scan", "lidar.scan", "Lidar"), ("stereo", "navcam.pair", "Stereo")):
            captures = drive.samples({stream: port})
            for name, pose_samples in poses.items():
                samples = sorted([*pose_samples, *captures], key=lambda s: (s.stamp_ns, s.port))
                config = {**CONFIG, "range_sigma_m": scenario.lidar.range_sigma_m}
                dem = build_map(samples, drive.context, variant, config)
                errors, aligned = compare(dem, terrain), compare(dem, terrain, remove_shift=True)
                report[f"{drive.robot}, {variant.lower()}, {name}"] = _rounded(
                    {**errors, "rmse_without_shift_and_tilt_m": aligned["rmse_m"]}
                )
        drive.log.close()
    return report


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: errors and interval coverage of the drives with other seeds, as SVG."""
    rows = figures["other seeds (simulated), lidar, 5 cm"]["rows"]
    names = list(rows)
    error: list[Bar | None] = [
        tuple(1e3 * rows[n]["rmse_m"][k] for k in ("median", "min", "p95")) for n in names
    ]
    inside: list[Bar | None] = [
        tuple(100 * v for v in _mean_with_interval(rows[n]["within_90_percent"])) for n in names
    ]
    return chart(
        [
            Panel("RMSE per drive, mm: median, minimum to 95 %", names, {"maps": error}, 40.0),
            Panel(
                "90 % interval coverage, %: mean, 95 % (grey: target)",
                names,
                {"maps": inside},
                100.0,
                (88.0, 92.0),
            ),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables: the frozen traverse, then the drives with other seeds and the rules of atlaas."""
    frozen = figures["rover_traverse (simulated), 5 cm"]
    lines = [
        f"| `{SCENARIO}`, seed {frozen['seed']} | bias, mm | RMSE, mm | NMAD, mm | RMSE without shift and "
        "tilt, mm | within the 90 % interval |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in frozen.items():
        if isinstance(row, dict):
            lines.append(
                f"| {name} | {1e3 * row['bias_m']:.1f} | {1e3 * row['rmse_m']:.1f} | "
                f"{1e3 * row['nmad_m']:.1f} | {1e3 * row['rmse_without_shift_and_tilt_m']:.1f} | "
                f"{100 * row['within_90_percent']:.1f} % |"
            )
    other = figures["other seeds (simulated), lidar, 5 cm"]
    lines += [
        "",
        f"| {other['drives']} drives, seeds {other['seeds'][0]} to {other['seeds'][1]} | bias, root mean "
        "square, mm | RMSE of a drive, median (95 %), mm | RMSE relative to true poses | within "
        "the 90 % interval, mean (95 % of the mean) |",
        "|---|---|---|---|---|",
    ]
    for name, row in other["rows"].items():
        mean, low, high = _mean_with_interval(row["within_90_percent"])
        rmse = row["rmse_m"]
        lines.append(
            f"| {name} | {1e3 * row['bias_rms_m']:.1f} | {1e3 * rmse['median']:.1f} "
            f"({1e3 * rmse['p95']:.1f}) | {row['rmse_ratio']:.2f} | {100 * mean:.1f} % "
            f"({100 * low:.1f}–{100 * high:.1f}) |"
        )
    return "\n".join(lines)


def _mean_with_interval(statistics: dict[str, float]) -> tuple[float, float, float]:
    """Return the mean and the ends of its 95 % interval."""
    half = 1.96 * statistics["standard_error"]
    return statistics["mean"], statistics["mean"] - half, min(statistics["mean"] + half, 1.0)


def _kitti(folder: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the height of the left camera above the mapped road (1.65 m according to the data set)."""
    progress("dem: KITTI")
    P = np.loadtxt(folder / "calib_kitti.txt").reshape(-1, 3, 4)
    T = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    T_c0_c = np.tile(np.eye(4), (len(T), 1, 1))
    T_c0_c[:, :3, :3], T_c0_c[:, :3, 3] = se3.normalise_rotation(T[:, :, :3]), T[:, :, 3]
    T_site_base = T_BASE_CAMERA @ T_c0_c @ se3.inverse(T_BASE_CAMERA)
    frames = FrameGraph()
    frames.set_static("kitti/base", "kitti/navcam_left", UncertainTransform.exact(T_BASE_CAMERA))

    def samples() -> Iterator[Sample]:
        for i, pose in enumerate(T_site_base):
            stamp_ns = i * 100_000_000
            left, right = (
                cv2.imread(str(folder / f"image_{s}_kitti" / f"{i:06d}.png"), cv2.IMREAD_GRAYSCALE)
                for s in "lr"
            )
            yield Sample(
                "stereo",
                stamp_ns,
                i,
                FramePair.from_images(
                    left,
                    right,
                    baseline_m=-P[1][0, 3] / P[1][0, 0],
                    camera_matrix=P[0][:, :3],
                    stamp_ns=stamp_ns,
                    sensor="kitti/navcam_left",
                ),
            )
            yield Sample(
                "poses",
                stamp_ns,
                i,
                TransformWithCovariance.from_transform(
                    UncertainTransform(pose), parent="site", child="kitti/base", stamp_ns=stamp_ns
                ),
            )

    config = {"resolution_m": 0.2, "max_height_m": 1.0, "fusion": {"size_m": 150.0}}
    dem = build_map(samples(), DfpcContext("kitti", frames), "Stereo", config)
    row, col, inside = dem.geometry.cells_of(T_site_base[:, 0, 3], T_site_base[:, 1, 3])
    height_m = (T_site_base[:, 2, 3] - dem.layer("mean")[row, col])[inside]
    height_m = height_m[np.isfinite(height_m)]
    return _rounded(
        {
            "places": len(height_m),
            "median_height_m": float(np.median(height_m)),
            "std_m": float(height_m.std()),
        }
    )


def _rounded(scores: dict[str, Any]) -> dict[str, Any]:
    return {k: round(v, 5) if isinstance(v, float) else v for k, v in scores.items()}
