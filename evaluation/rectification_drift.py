# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate how visual_odometry_sparse reports a right camera that moves during a drive (KITTI 06).

The right images are resampled as after a rotation of the right camera, or with an offset of their rows, from
one pair on. The pose error is the difference from the run without this change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from evaluation.data_sets import kitti

#: Pair from which on the camera has moved.
FIRST = 20
#: Rows (pixels) and rotation vector (degrees) of the change.
CHANGES: dict[str, tuple[float, tuple[float, float, float]]] = {
    "none": (0.0, (0.0, 0.0, 0.0)),
    "rows, 1 px": (1.0, (0.0, 0.0, 0.0)),
    "pitch, 0.1°": (0.0, (0.1, 0.0, 0.0)),
    "yaw, 0.1°": (0.0, (0.0, 0.1, 0.0)),
    "roll, 0.1°": (0.0, (0.0, 0.0, 0.1)),
}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return, for each change, the pairs until it is reported and the pose error then and at the end."""
    pairs, _ = kitti.read(data / kitti.SEQUENCE)
    figures: dict[str, Any] = {"pairs": len(pairs), "first": FIRST, "changes": {}}
    reference: list[FloatArray] = []
    for name, (rows_px, rotation_deg) in CHANGES.items():
        progress(f"rectification drift: {name}")
        poses, sigmas, reasons, failed = _run(pairs, rows_px, rotation_deg)
        if name == "none":
            reference = poses
        errors = [float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in zip(poses, reference, strict=True)]
        reported = [k for k in range(FIRST if name != "none" else 0, len(pairs)) if reasons[k]]
        first = reported[0] if reported else None
        figures["changes"][name] = {
            "pairs_until_report": None if first is None else first - FIRST + 1,
            "false_reports": sum(bool(reasons[k]) for k in range(FIRST)),
            "reasons": sorted({reason.split(":")[0] for own in reasons for reason in own}),
            "failed": sum(failed),
            "error_at_report_m": None if first is None or failed[first] else errors[first],
            "error_end_m": None if failed[-1] else errors[-1],
            "sigma_end_m": sigmas[-1],
        }
    return figures


def _run(
    pairs: Sequence[FramePair], rows_px: float, rotation_deg: tuple[float, float, float]
) -> tuple[list[FloatArray], list[float], list[list[str]], list[bool]]:
    """Return poses, standard deviations of the position, reasons about the rectification, and refusals."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure({}, DfpcContext("kitti"))
    poses: list[FloatArray] = []
    sigmas: list[float] = []
    reasons: list[list[str]] = []
    failed: list[bool] = []
    for k, rectified in enumerate(pairs):
        pair = rectified
        if k >= FIRST:
            K, left = np.asarray(pair.camera_matrix), np.array(pair.left.image)
            right = _moved(np.array(pair.right.image), K, rows_px, rotation_deg)
            pair = FramePair.from_images(
                left, right, baseline_m=pair.baseline, camera_matrix=K, stamp_ns=pair.stamp_ns
            )
        outputs = dfpc.step(Sample("stereo", pair.stamp_ns, k, pair, id=str(k)))
        output = next(o for o in outputs if o.port == "pose")
        own = ("row_offset", "camera_roll", "camera_yaw_change", "stereo_mismatch")
        reasons.append([r for r in output.quality.reasons if r.split(":")[0] in own])
        failed.append(output.value is None)
        if output.value is None:
            poses.append(poses[-1])
            sigmas.append(sigmas[-1])
            continue
        transform = output.value.transform
        poses.append(transform.matrix)
        sigmas.append(float(np.sqrt(np.trace(transform.covariance[:3, :3]))))
    return poses, sigmas, reasons, failed


def _moved(image: Any, K: FloatArray, rows_px: float, rotation_deg: tuple[float, float, float]) -> Any:
    """Return the image of a camera that was rotated, with its rows moved down."""
    H = K @ se3.exp_so3(np.deg2rad(rotation_deg)) @ np.linalg.inv(K)
    H = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, rows_px], [0.0, 0.0, 1.0]]) @ H
    size = image.shape[1::-1]
    return cv2.warpPerspective(image, H, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def table(figures: dict[str, Any]) -> str:
    """Return the table."""
    lines = [
        "| change of the right camera | pairs until report | reasons | FAILED pairs | pose error then "
        "| pose error at the end | stated σ there |",
        "|---" * 7 + "|",
    ]
    for name, row in figures["changes"].items():
        until = row["pairs_until_report"]
        error, end = (
            "–" if row[key] is None else f"{100 * row[key]:.1f} cm"
            for key in ("error_at_report_m", "error_end_m")
        )
        lines.append(
            f"| {name} | {'not reported' if until is None else until} | {', '.join(row['reasons']) or '–'} "
            f"| {row['failed']} | {error} | {end} | {100 * row['sigma_end_m']:.1f} cm |"
        )
    return "\n".join(lines)
