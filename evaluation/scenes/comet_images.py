# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""visual_target_tracking on the photographs of comet 67P, from a guess and with its known spin."""

from __future__ import annotations

import csv
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.formats.meshes.read import read_mesh
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, Mesh, TransformWithCovariance, Vector3d

#: Camera of the photographs, README.txt of the set, px.
FOCAL_PX, MIDDLE_PX = 5863.2, 256.0
#: Standard deviations of the guess: across, along the optical axis, metres, and rotation, degrees per axis.
GUESS_M, GUESS_DEG = (80.0, 80.0, 1000.0), 1.0
#: Period of the spin, hours, README.txt of the set, along the third axis of the mesh.
PERIOD_H = 12.4042
#: A free body in the frame of a camera that turns slowly (some degrees in an hour). Texture is not tracked:
#: between photographs an hour apart, the shadows move across the surface.
CONFIG: dict[str, Any] = {
    "texture": False,
    "unit": "km",
    "initial_rate_radps": (0.0, 0.0, 2.0 * np.pi / (3600.0 * PERIOD_H)),
    "initial_rate_sigma_radps": 1e-5,
    "lost_after_s": 1e5,
    "predict": {"acceleration_noise": 1e-3, "angular_acceleration_noise": 5e-7},
}


def comet_rows(
    folder: Path,
    seed: int,
    *,
    with_sun: bool = True,
    dark: range = range(0),
    config: Mapping[str, Any] | None = None,
) -> list[dict[str, Any]]:
    """Return the errors for each photograph.

    Parameters
    ----------
    folder : Path
    seed : int
        Of the errors of the guess.
    with_sun : bool
        The compound receives the direction to the Sun.
    dark : range
        Photographs that are black.
    config : mapping
        Further parameters of the compound.
    """
    import cv2

    with (folder / "truth.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    poses = [_pose(row) for row in table]
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure({**CONFIG, **(config or {})})
    mesh = read_mesh(folder / "67p_16k.ply")
    model = Mesh.from_arrays(mesh.vertices, mesh.triangles, frame="67p/body", stamp_ns=0)
    list(dfpc.step(Sample("model", 0, 0, model)))
    list(dfpc.step(Sample("guess", 0, 0, _guess(poses[0], seed))))
    K = np.array([[FOCAL_PX, 0.0, MIDDLE_PX], [0.0, FOCAL_PX, MIDDLE_PX], [0.0, 0.0, 1.0]])
    rows = []
    for k, (row, T) in enumerate(zip(table, poses, strict=True)):
        stamp_ns = round(1e6 * float(row["unix_s"])) * 1000
        pixels = np.asarray(cv2.imread(str(folder / "images" / row["image"]), cv2.IMREAD_GRAYSCALE), np.uint8)
        if k in dark:
            pixels = np.zeros_like(pixels)
        if with_sun:
            sun = Vector3d(values=np.array([float(row[f"sun_{axis}"]) for axis in "xyz"]))
            list(dfpc.step(Sample("sun", stamp_ns, k, sun)))
        frame = Frame.from_image(pixels, sensor="camera", stamp_ns=stamp_ns, camera_matrix=K)
        start_s = time.process_time()
        pose, _ = dfpc.step(Sample("image", stamp_ns, k, frame))
        rows.append(_row(T, pose.value, pose.quality.reasons) | {"cpu_s": time.process_time() - start_s})
    return rows


def _row(T: FloatArray, value: Any, reasons: tuple[str, ...]) -> dict[str, Any]:
    """Return the errors of a published pose; NaN without one."""
    row = {"px": np.nan, "deg": np.nan, "range_percent": np.nan, "nees": np.nan, "reasons": list(reasons)}
    if value is None:
        return row
    estimate = value.transform
    error = pose_error(T, estimate.matrix)
    position = estimate.matrix[:3, 3]
    return row | {
        "px": FOCAL_PX * float(np.linalg.norm(position[:2] / position[2] - T[:2, 3] / T[2, 3])),
        "deg": float(np.degrees(np.linalg.norm(error[3:]))),
        "range_percent": 100.0 * abs(float(error[2])) / float(T[2, 3]),
        "nees": float(error @ np.linalg.solve(estimate.covariance, error)),
    }


def comet_summary(runs: list[list[dict[str, Any]]]) -> dict[str, Any]:
    """Return the figures of runs."""
    rows = [row for run in runs for row in run]
    measured_rows = [row for row in rows if "coasting" not in row["reasons"] and np.isfinite(row["px"])]
    far = [row for row in rows if row["px"] > 5.0 or row["deg"] > 5.0]
    result: dict[str, Any] = {"images": len(rows), "used": len(measured_rows)}
    for name in ("px", "deg", "range_percent", "nees"):
        values = [row[name] for row in measured_rows] or [float("nan")]
        result[f"median_{name}"] = _rounded(np.median(values))
        result[f"largest_{name}"] = _rounded(np.max(values))
    result["failed"] = sum(not np.isfinite(row["px"]) for row in rows)
    result["far"] = len(far)
    result["far_and_ok"] = sum(not row["reasons"] for row in far)
    result["median_cpu_ms"] = _rounded(1e3 * np.median([row["cpu_s"] for row in rows]))
    return result


def comet_table(figures: Mapping[str, Any]) -> list[str]:
    """Return the lines of the table."""
    lines = [
        "| 67P | images used | median | largest | range, median | median NEES | beyond 5 px or 5° "
        "(of them OK) | CPU ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in figures.items():
        lines.append(
            f"| {name} | {row['used']} of {row['images']} | {row['median_px']} px, {row['median_deg']}° | "
            f"{row['largest_px']} px, {row['largest_deg']}° | {row['median_range_percent']} % | "
            f"{row['median_nees']} | {row['far']} ({row['far_and_ok']}) | {row['median_cpu_ms']} |"
        )
    return lines


def _pose(row: Mapping[str, str]) -> FloatArray:
    """Return T_camera_body (4, 4), metres."""
    w, x, y, z = (float(row[name]) for name in ("qw", "qx", "qy", "qz"))
    position = np.array([1e3 * float(row[f"t{axis}_km"]) for axis in "xyz"])
    return se3.transform(se3.matrix_from_quaternion_xyzw([x, y, z, w]), position)


def _guess(T: FloatArray, seed: int) -> TransformWithCovariance:
    """Return a pose with random errors and their covariance."""
    rng = np.random.default_rng(seed)
    sigmas = np.concatenate([GUESS_M, np.repeat(np.radians(GUESS_DEG), 3)])
    error = rng.normal(0.0, sigmas)
    guess = se3.transform(se3.exp_so3(error[3:]) @ T[:3, :3], T[:3, 3] + error[:3])
    return TransformWithCovariance.from_transform(
        UncertainTransform(guess, np.diag(sigmas**2)), parent="camera", child="67p/body", stamp_ns=0
    )


def _rounded(value: Any) -> float | None:
    return float(f"{float(value):.3g}") if np.isfinite(value) else None
