# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate visual odometry on a KITTI drive with pasted objects, calibration errors and stereo faults.

The NEES is that of the motion between the first and the last pose: ``e^T P^-1 e`` with
the error ``e`` (6,) of ``pose_error`` and the stated covariance P; 6 is expected.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry import covariance as cov
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair, TransformWithCovariance
from evaluation.data_sets.kitti import SEQUENCE, measured_from, path_lengths_m, read
from evaluation.data_sets.pasted_object import PlanarObject, paste
from evaluation.real import RealRow

#: Page that contains the table of this evaluation.
PAGE = "visual_odometry_sparse"

FloatArray = NDArray[np.float64]
#: Objects that cover 22 % of the left image; corner and size in pixels, depth and motion per pair in metres.
OBJECTS = {
    "fixed to the robot, left": PlanarObject((0, 190), (560, 180), 3.9),
    "fixed to the robot, centre": PlanarObject((380, 100), (440, 228), 6.0, seed=3),
    "moves away": PlanarObject((400, 60), (500, 200), 9.0, (0.02, 0.0, 0.05)),
    "moves to the right": PlanarObject((100, 120), (420, 238), 12.0, (0.25, 0.0, 0.0)),
}
#: Objects over more than half of the left image.
LARGE_OBJECTS = {
    "fixed to the robot, left": PlanarObject((0, 0), (680, 370), 5.0),
    "fixed to the robot, centre": PlanarObject((230, 30), (780, 320), 6.0, seed=3),
    "moves away": PlanarObject((230, 30), (780, 320), 9.0, (0.02, 0.0, 0.05)),
    "moves to the right": PlanarObject((0, 10), (780, 350), 12.0, (0.25, 0.0, 0.0)),
}
#: Number of pairs with these objects, from the first measured pose of the reference.
_LARGE_OBJECT_PAIRS = 20
#: Simulated wheels measure the reference times this ratio.
_WHEEL_RATIO = 1.05
#: Mount of the camera, which looks along x of the robot.
_T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.0, 0.0, 1.65])
#: Parameters for simulated images and an exact calibration.
NOISE_ONLY: dict[str, Any] = {
    "motion": {
        "sigma_common_px": 0.003,
        "calibration": dict.fromkeys(
            ("focal_length_ratio", "baseline_ratio", "principal_point_px", "rotation_deg", "distortion_px"),
            0.0,
        ),
    }
}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results for each object, and for each error of the calibration or of the pairs."""
    pairs, truth = read(data / SEQUENCE)
    objects = {}
    for name, planar_object in OBJECTS.items():
        progress(f"visual odometry: object {name}")
        row = score(run(paste(pairs, planar_object)), truth)
        objects[name] = {"coverage": round(planar_object.coverage(pairs[0]), 3), **row}
    start = measured_from(truth)
    large_objects = _large_objects(pairs[start:], truth[start:], progress)
    pairs, truth = pairs[start:], se3.inverse(truth[start]) @ truth[start:]
    errors: dict[str, Any] = {}
    for name, change in _errors(pairs[0]).items():
        progress(f"visual odometry: {name}")
        errors[name] = score(run([change(pair) for pair in pairs]), truth)
    late = [_pair(a, b) for a, b in zip(pairs[1:], pairs[:-1], strict=True)]
    errors["right camera one pair late"] = score(run(late), se3.inverse(truth[1]) @ truth[1:])
    progress("visual odometry: noise only")
    errors["none, without the error budget"] = score(run(pairs, NOISE_ONLY), truth)
    return {
        "data": SEQUENCE,
        "first_pair": start,
        "objects": objects,
        "large_objects": large_objects,
        "errors": errors,
    }


def _large_objects(
    pairs: Sequence[FramePair], truth: FloatArray, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Return the results for each object over more than half of the image, without and with wheels."""
    pairs = pairs[:_LARGE_OBJECT_PAIRS]
    truth = se3.inverse(truth[0]) @ truth[: len(pairs)]
    results = {}
    for name, planar_object in LARGE_OBJECTS.items():
        progress(f"visual odometry: large object {name}")
        disturbed = paste(pairs, planar_object)
        results[name] = {
            "coverage": round(planar_object.coverage(pairs[0]), 3),
            "no prior": score(run(disturbed), truth),
            "wheels": score(
                run(disturbed, wheels=_T_BASE_CAMERA @ truth @ se3.inverse(_T_BASE_CAMERA)), truth
            ),
        }
    return results


def run(
    pairs: Sequence[FramePair], parameters: dict[str, Any] | None = None, wheels: FloatArray | None = None
) -> list[Output]:
    """Return the output for each pair, with default parameters unless others are given.

    ``wheels`` (n, 4, 4) are the true poses of the robot, from which the simulated wheel odometry is made.
    """
    frames = FrameGraph()
    frames.set_static("kitti/base", "kitti/navcam_left", UncertainTransform.exact(_T_BASE_CAMERA))
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(parameters, DfpcContext("kitti", frames))
    outputs: list[Output] = []
    for i, pair in enumerate(pairs):
        if wheels is not None:
            T = UncertainTransform(se3.transform(wheels[i, :3, :3], _WHEEL_RATIO * wheels[i, :3, 3]))
            pose = TransformWithCovariance.from_transform(
                T, parent="kitti/odom", child="kitti/base", stamp_ns=pair.stamp_ns
            )
            outputs += dfpc.step(Sample("odometry", pair.stamp_ns, i, pose))
        outputs += dfpc.step(Sample("stereo", pair.stamp_ns, i, pair, id=str(i)))
    return outputs


def score(outputs: Sequence[Output], truth: FloatArray) -> dict[str, Any]:
    """Return counts by status, reasons, end error and NEES of the last pose."""
    located = [i for i, output in enumerate(outputs) if output.value is not None and i > 0]
    counts = Counter(output.quality.status.value for output in outputs)
    reasons = sorted({reason.split(":")[0] for output in outputs for reason in output.quality.reasons})
    row: dict[str, Any] = {"pairs": len(outputs), "status": dict(counts), "reasons": reasons}
    if not located:
        return row
    T = outputs[located[-1]].value.transform
    error = cov.pose_error(truth[located[-1]], T.matrix)
    sigmas = np.sqrt(np.diag(T.covariance))
    length_m = float(path_lengths_m(truth)[located[-1]])
    return row | {
        "end_error_percent": round(100.0 * float(np.linalg.norm(error[:3])) / length_m, 3),
        "squared_error": round(float(error @ np.linalg.solve(T.covariance, error)), 1),
        "largest_ratio": round(float(np.abs(error / sigmas).max()), 2),
    }


def _errors(first: FramePair) -> dict[str, Callable[[FramePair], FramePair]]:
    """Return the function that applies each error to a pair."""
    K, baseline_m = np.array(first.camera_matrix), first.baseline
    longer = K * np.array([[1.01, 1.0, 1.0], [1.0, 1.01, 1.0], [1.0, 1.0, 1.0]])
    rotations = {
        f"right camera rotated by 0.05° about {axis}": K
        @ se3.exp_so3(np.radians(0.05) * np.eye(3)[i])
        @ np.linalg.inv(K)
        for i, axis in enumerate(("the baseline", "the vertical", "the optical axis"))
    }
    one_row = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    warps = {**rotations, "right image one row lower": one_row}
    return {
        "none": lambda pair: pair,
        "focal length 1 % too long": lambda pair: _pair(pair, pair, camera_matrix=longer),
        "baseline 1 % too long": lambda pair: _pair(pair, pair, baseline_m=1.01 * baseline_m),
        **{name: (lambda pair, warp=warp: _pair(pair, pair, warp=warp)) for name, warp in warps.items()},  # type: ignore[misc]
    }


def _pair(
    left: FramePair,
    right: FramePair,
    *,
    camera_matrix: FloatArray | None = None,
    baseline_m: float | None = None,
    warp: FloatArray | None = None,
) -> FramePair:
    """Return the left image of one pair and the right image of another, which is warped if required."""
    image = np.array(right.right.image)
    if warp is not None:
        image = np.asarray(
            cv2.warpPerspective(
                image, warp, image.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
            )
        )
    return FramePair.from_images(
        np.array(left.left.image),
        image,
        baseline_m=left.baseline if baseline_m is None else baseline_m,
        camera_matrix=np.array(left.camera_matrix) if camera_matrix is None else camera_matrix,
        stamp_ns=left.stamp_ns,
        sensor=left.frame,
    )


def table(figures: dict[str, Any]) -> str:
    """Return the tables of the page: objects, and errors of the calibration."""
    lines = [
        f"**Objects and calibration errors** ({figures['data']}; objects on all pairs, errors from pair "
        f"{figures['first_pair']}, where the measured reference starts). The NEES of the end "
        "pose is expected to be 6.",
        "",
        "| pasted object over 22 % of the image | OK, DEGRADED, FAILED | end error |",
        "|---|---|---|",
        *[f"| {name} | {_statuses(row)} | {_percent(row)} |" for name, row in figures["objects"].items()],
        "",
        f"Over more than half of the image, {_LARGE_OBJECT_PAIRS} pairs (the first has no motion); simulated "
        "wheels measure the reference times 1.05:",
        "",
        "| pasted object | coverage | no prior: OK, DEGRADED, FAILED | end error | NEES | "
        "with wheels: OK, DEGRADED, FAILED | end error |",
        "|---|---|---|---|---|---|---|",
        *[
            f"| {name} | {100 * row['coverage']:.0f} % | {_statuses(row['no prior'])} | "
            f"{_percent(row['no prior'])} | {row['no prior'].get('squared_error', '–')} | "
            f"{_statuses(row['wheels'])} | {_percent(row['wheels'])} |"
            for name, row in figures["large_objects"].items()
        ],
        "",
        "| error | OK, DEGRADED, FAILED | reasons | end error | NEES (6 expected) | largest error, σ |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in figures["errors"].items():
        reasons = ", ".join(f"`{reason}`" for reason in row["reasons"]) or "none"
        lines.append(
            f"| {name} | {_statuses(row)} | {reasons} | {_percent(row)} | {row.get('squared_error', '–')} | "
            f"{row.get('largest_ratio', '–')} |"
        )
    return "\n".join(lines)


def _statuses(row: dict[str, Any]) -> str:
    return ", ".join(str(row["status"].get(name, 0)) for name in ("OK", "DEGRADED", "FAILED"))


def _percent(row: dict[str, Any]) -> str:
    return f"{row['end_error_percent']:.2f} %" if "end_error_percent" in row else "no pose"


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    worst = max(row["end_error_percent"] for row in figures["objects"].values())
    errors = figures["errors"]
    return [
        RealRow(
            "KITTI 06, textured object over 22 % of the image, end error",
            "100 %",
            f"{worst} % at most",
            "",
            "≤ 5 % or flagged",
        ),
        RealRow(
            "KITTI 06, NEES (6 expected)",
            str(errors["none, without the error budget"]["squared_error"]),
            str(errors["none"]["squared_error"]),
            "",
            "≤ 60",
        ),
    ]
