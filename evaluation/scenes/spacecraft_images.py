# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The photographs of a satellite mock-up (SPEED+), and visual_target_tracking on each from a wrong pose."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.formats.meshes.read import read_mesh
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, Mesh, TransformWithCovariance
from cdff_core.dfns.image_undistortion.interface import ImageUndistortionInputs
from cdff_core.dfns.image_undistortion.lens_map import LensMap

FOLDER = "speedplus_lightbox"
#: Errors of the starts: rotation about any axis, degrees; range and offset across, relative to the range.
START_DEG, START_RANGE, START_ACROSS, SEEDS = 3.0, 0.02, 0.02, 3
#: Limits of a right result, and of a result that is beyond recovery: rotation, degrees; position per range.
RIGHT_DEG, RIGHT_POSITION, FAR_DEG = 2.0, 0.02, 5.0


def photographs(data: Path) -> Iterator[tuple[str, Frame, FloatArray]]:
    """Yield the name, the image with its lens distortion, and the true T_camera_body of each photograph."""
    import cv2

    folder = data / FOLDER
    camera = json.loads((folder / "camera.json").read_text(encoding="utf-8"))
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for k, row in enumerate(rows):
        pixels = cv2.imread(str(folder / "images" / row["image"]), cv2.IMREAD_GRAYSCALE)
        frame = Frame.from_image(
            np.asarray(pixels, np.uint8),
            stamp_ns=1000 * (k + 1),
            mode="GRAY",
            sensor="camera",
            camera_matrix=camera["cameraMatrix"],
            dist_coeffs=np.ravel(camera["distCoeffs"]),
        )
        R = se3.matrix_from_quaternion_xyzw([float(row[name]) for name in ("qx", "qy", "qz", "qw")])
        yield row["image"], frame, se3.transform(R, [float(row[name]) for name in ("tx_m", "ty_m", "tz_m")])


def tango_model(data: Path) -> Sample:
    """Return the mesh of the satellite as a model."""
    arrays = read_mesh(data / FOLDER / "tango.ply")
    mesh = Mesh.from_arrays(arrays.vertices, arrays.triangles, frame="tango/body", stamp_ns=0)
    return Sample("model", 0, 0, mesh, id="model")


def start_near(T: FloatArray, rng: np.random.Generator) -> TransformWithCovariance:
    """Return a start whose errors have the stated sizes and random directions, with their covariance."""
    axis, angle = rng.normal(size=3), rng.uniform(0.0, 2.0 * np.pi)
    range_m = float(np.linalg.norm(T[:3, 3]))
    error_m = range_m * np.array(
        [START_ACROSS * np.cos(angle), START_ACROSS * np.sin(angle), START_RANGE * rng.choice([-1.0, 1.0])]
    )
    R = se3.exp_so3(np.radians(START_DEG) * axis / np.linalg.norm(axis)) @ T[:3, :3]
    sigmas = np.array([START_ACROSS / np.sqrt(2.0), START_ACROSS / np.sqrt(2.0), START_RANGE]) * range_m
    rotation = np.repeat(np.radians(START_DEG) / np.sqrt(3.0), 3)
    covariance = np.diag(np.concatenate([sigmas, rotation]) ** 2)
    return TransformWithCovariance.from_transform(
        UncertainTransform(se3.transform(R, T[:3, 3] + error_m), covariance),
        parent="camera",
        child="tango/body",
        stamp_ns=0,
    )


def spacecraft_rows(
    data: Path, progress: Callable[[str], None], config: Mapping[str, Any] | None = None
) -> list[dict[str, Any]]:
    """Return errors and reasons for each photograph and start; ``config`` is that of the DFPC."""
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure(dict(config or {}))
    list(dfpc.step(tango_model(data)))
    undistort = LensMap()
    undistort.configure()
    rows = []
    for name, distorted, T in photographs(data):
        frame = undistort.process(ImageUndistortionInputs(image=distorted)).image
        for seed in range(SEEDS):
            start = start_near(T, np.random.default_rng([seed, int(frame.stamp_ns)]))
            dfpc.restart()
            list(dfpc.step(Sample("guess", 0, 0, start)))
            start_s = time.process_time()
            pose, _ = dfpc.step(Sample("image", int(frame.stamp_ns), seed, frame))
            row = {"image": name, "seed": seed, "cpu_s": round(time.process_time() - start_s, 4)}
            row |= {"reasons": [reason for reason in pose.quality.reasons if reason != "new_track"]}
            row |= {"start": _errors(start.transform.matrix, T)}
            if pose.value is not None:
                found = pose.value.transform
                error = pose_error(T, found.matrix)
                row |= _errors(found.matrix, T)
                row |= {"nees": float(f"{error @ np.linalg.solve(found.covariance, error):.3g}")}
            rows.append(row)
        progress(f"visual_target_tracking: {name}")
    return rows


def _errors(T: FloatArray, T_true: FloatArray) -> dict[str, float]:
    """Return the rotation error, degrees, and the position error relative to the range."""
    distance_m = float(np.linalg.norm(T[:3, 3] - T_true[:3, 3]))
    return {
        "deg": round(float(np.degrees(se3.rotation_angle(T[:3, :3].T @ T_true[:3, :3]))), 3),
        "position": round(distance_m / float(np.linalg.norm(T_true[:3, 3])), 5),
    }


def spacecraft_summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the counts; a result is flagged if it has a reason other than ``new_track``, or no pose."""
    right = [row for row in rows if _is_right(row)]
    far = [row for row in rows if not row.get("deg", np.inf) <= FAR_DEG]
    worse = [row for row in rows if _is_worse(row)]
    nees = [row["nees"] for row in rows if "nees" in row]
    by_seed = [sum(row["seed"] == seed for row in right) for seed in range(SEEDS)]
    return {
        "images": len(rows) // SEEDS,
        "right_by_start": by_seed,
        "right_median": float(np.median(by_seed)),
        "right": len(right),
        "right_and_ok": sum(not row["reasons"] for row in right),
        "far": len(far),
        "far_flagged": sum(bool(row["reasons"]) or "deg" not in row for row in far),
        "worse": len(worse),
        "worse_flagged": sum(bool(row["reasons"]) for row in worse),
        "median_nees": float(f"{np.median(nees):.3g}") if nees else None,
        "median_cpu_ms": float(f"{1e3 * np.median([row['cpu_s'] for row in rows]):.3g}"),
        "rows": rows,
    }


def _is_right(row: Mapping[str, Any]) -> bool:
    return "deg" in row and row["deg"] <= RIGHT_DEG and row["position"] <= RIGHT_POSITION


def _is_worse(row: Mapping[str, Any]) -> bool:
    """Return whether rotation or position are further from the truth than at the start."""
    start = row["start"]
    return "deg" in row and (row["deg"] > start["deg"] or row["position"] > start["position"])


def spacecraft_table(figures: Mapping[str, Any]) -> list[str]:
    """Return the lines of the table."""
    lines = [
        f"| SPEED+, {SEEDS} starts | right, median of the starts | right and not flagged | beyond "
        f"{FAR_DEG:g}°, flagged | worse than the start, flagged | median NEES (5.3 expected) | CPU ms |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, row in figures.items():
        lines.append(
            f"| {name} | {row['right_median']:g} of {row['images']} | "
            f"{row['right_and_ok']} of {row['right']} | {row['far_flagged']} of {row['far']} | "
            f"{row['worse_flagged']} of {row['worse']} | {row['median_nees']} | {row['median_cpu_ms']} |"
        )
    return lines
