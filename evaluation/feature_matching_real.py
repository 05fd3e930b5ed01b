# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare the relative poses of feature matching with OpenCV (SIFT, MAGSAC++) on real pairs, in one run.

The pose of a stereo rig is its calibration, that of a moving camera the reference of the set. The poses of
the kitchen belong to the depth camera: the NEES is computed with the sum of the covariances of result
and reference, the errors in degrees contain those of the reference.

The kitchen's camera is not calibrated: its nominal matrix is used with the errors of such cameras.

The axes of KITTI's reference are rotated relative to the camera, so that all methods have the same mean error
of the direction. For its moving camera, the error about the mean of both methods is stated too.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.types import Frame
from cdff_core.imaging.sampson import sampson
from evaluation.data_sets.relative_poses import PosedPair, posed_pairs
from evaluation.feature_matching import make_matcher
from evaluation.real import RealRow

Float = NDArray[np.float64]
PAGE = "feature_matching"
#: Every n-th pair of each set; distance of a correct match from the true epipolar line.
STRIDE, CORRECT_PX = 10, 1.5
#: Sets whose reference has a constant rotation to the camera.
_ROTATED_SETS = ("kitti_1_frames", "kitti_3_frames")


def evaluate(data: Path, progress: Callable[[str], None], stride: int = STRIDE) -> dict[str, Any]:
    """Return the results of each set and method."""
    cv2.setNumThreads(1)
    matchers: dict[bool, Dfpc] = {}
    rows: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: {"cdff": [], "opencv": []})
    for pair in posed_pairs(data, stride):
        progress(f"feature_matching_real: {pair.set_name}")
        is_nominal = bool(pair.camera_errors)
        if is_nominal not in matchers:
            matchers[is_nominal] = make_matcher("RootSift", **_of_cameras(pair.camera_errors))
        matched = match_cdff(matchers[is_nominal], pair)
        rows[pair.set_name]["cdff"].append(_compare_with_reference(pair, *matched))
        rows[pair.set_name]["opencv"].append(_compare_with_reference(pair, *match_opencv(pair)))
    results: dict[str, Any] = {}
    for name, methods in rows.items():
        results[name] = {
            "pairs": len(methods["cdff"]),
            **{method: _combine(v) for method, v in methods.items()},
        }
        if name in _ROTATED_SETS:
            errors = {
                method: np.array([row["direction_error"] for row in v]) for method, v in methods.items()
            }
            mean = np.nanmean(np.concatenate(list(errors.values())), axis=0)
            for method, values in errors.items():
                from_mean_deg = np.degrees(np.linalg.norm(values - mean, axis=1))
                results[name][method]["about_common_mean_deg"] = round(float(np.nanmedian(from_mean_deg)), 3)
    return results


def _of_cameras(errors: dict[str, float]) -> dict[str, dict[str, float]]:
    """Return the parameters of the slots that estimate poses, given the errors of the cameras."""
    return dict.fromkeys(("essential", "decompose"), errors) if errors else {}


def match_cdff(dfpc: Dfpc, pair: PosedPair) -> tuple[Float, Float | None, Float | None, bool, float]:
    """Return matches ``(n, 4)``, ``T_left_right``, its covariance, whether it is OK, and CPU seconds."""
    dfpc.call("forget", {})
    started = time.process_time()
    outputs = {
        output.port: output
        for port, image, K in (("left", pair.left, pair.K_left), ("right", pair.right, pair.K_right))
        for output in dfpc.step(Sample(port, 0, 0, Frame.from_image(image, stamp_ns=0, camera_matrix=K)))
    }
    cpu_s = time.process_time() - started
    matches, transform = (outputs[p].value if p in outputs else None for p in ("matches", "transform"))
    xy = np.zeros((0, 4)) if matches is None else np.hstack([matches.sources_px, matches.sinks_px])
    if transform is None:
        return xy, None, None, False, cpu_s
    is_ok = outputs["transform"].quality.status.value == "OK"
    return xy, transform.transform.matrix, transform.transform.covariance, is_ok, cpu_s


def match_opencv(pair: PosedPair) -> tuple[Float, Float | None, Float | None, bool, float]:
    """Return the same of OpenCV: SIFT, ratio 0.8, essential matrix by MAGSAC++, decomposition."""
    started = time.process_time()
    sift = cv2.SIFT_create()
    (first, a), (second, b) = (sift.detectAndCompute(image, None) for image in (pair.left, pair.right))
    nearest = [m for m, n in cv2.BFMatcher().knnMatch(a, b, k=2) if m.distance < 0.8 * n.distance]
    xy = np.array([(*first[m.queryIdx].pt, *second[m.trainIdx].pt) for m in nearest]).reshape(-1, 4)
    left, right = np.ascontiguousarray(xy[:, :2]), np.ascontiguousarray(xy[:, 2:])
    E, mask = cv2.findEssentialMat(
        left, right, pair.K_left, None, pair.K_right, None, cv2.USAC_MAGSAC, 0.999, 1.0
    )
    rays = (cv2.undistortPoints(p[:, None], K, None) for p, K in ((left, pair.K_left), (right, pair.K_right)))
    _, R, t, _ = cv2.recoverPose(E, *rays, np.eye(3), mask=mask.copy())
    cpu_s = time.process_time() - started
    return xy[mask.ravel() > 0], se3.inverse(se3.transform(R, t[:, 0])), None, True, cpu_s


def _compare_with_reference(
    pair: PosedPair, matches: Float, T: Float | None, covariance: Float | None, is_ok: bool, cpu_s: float
) -> dict[str, Any]:
    true = pair.T_left_right.copy()
    true[:3, 3] /= np.linalg.norm(true[:3, 3])
    inverse = se3.inverse(true)
    E = se3.skew(inverse[:3, 3]) @ inverse[:3, :3]
    F = np.linalg.inv(pair.K_right).T @ E @ np.linalg.inv(pair.K_left)
    correct = np.abs(sampson(F, matches[:, :2], matches[:, 2:])) < CORRECT_PX
    row: dict[str, Any] = {
        "matches": float(len(matches)),
        "correct": float(correct.sum()),
        "cpu_s": cpu_s,
        "ok": float(is_ok),
    }
    row |= {"rotation_deg": np.nan, "direction_deg": np.nan, "squared_error": np.nan}
    row["direction_error"] = np.full(3, np.nan)
    if T is not None:
        angle = np.arctan2(np.linalg.norm(np.cross(true[:3, 3], T[:3, 3])), true[:3, 3] @ T[:3, 3])
        row["direction_error"] = T[:3, 3] - true[:3, 3]
        row["direction_deg"] = float(np.degrees(angle))
        row["rotation_deg"] = float(np.degrees(np.linalg.norm(se3.log_so3(true[:3, :3].T @ T[:3, :3]))))
    if T is not None and covariance is not None:
        error = cov.pose_error(true, T)
        total = covariance + _covariance_of_unit_translation(pair, T)
        row["squared_error"] = float(error @ np.linalg.pinv(total, rcond=1e-9, hermitian=True) @ error / 5)
    return row


def _covariance_of_unit_translation(pair: PosedPair, T: Float) -> Float:
    """Return the covariance (6, 6) of the true pose with the translation of length 1 of T."""
    scale = np.eye(6)
    scale[:3, :3] = (np.eye(3) - np.outer(T[:3, 3], T[:3, 3])) / np.linalg.norm(pair.T_left_right[:3, 3])
    return np.asarray(scale @ pair.covariance @ scale.T)


def _combine(rows: list[dict[str, Any]]) -> dict[str, Any]:
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    has_pose = np.isfinite(columns["direction_deg"])
    if not has_pose.any():
        return {"poses": 0}
    poses = {key: columns[key][has_pose] for key in ("rotation_deg", "direction_deg", "squared_error")}
    result: dict[str, Any] = {
        "poses": int(has_pose.sum()),
        "ok": int(columns["ok"].sum()),
        "matches": round(float(columns["matches"].mean())),
        "correct_percent": round(100.0 * float(columns["correct"].sum() / columns["matches"].sum()), 1),
        "rotation_median_deg": round(float(np.median(poses["rotation_deg"])), 3),
        "direction_median_deg": round(float(np.median(poses["direction_deg"])), 2),
        "direction_max_deg": round(float(poses["direction_deg"].max()), 1),
        "cpu_s": round(float(columns["cpu_s"].mean()), 2),
    }
    if np.isfinite(poses["squared_error"]).all():
        result["squared_error_median"] = round(float(np.median(poses["squared_error"])), 1)
        result["squared_error_mean"] = round(float(np.mean(poses["squared_error"])), 1)
    return result


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each set and method."""
    heads = ("set", "method", "poses (OK)", "matches", "within 1.5 px of the true line")
    heads += ("rotation error", "direction error, median (maximum)", "about the common mean, median")
    heads += ("NEES per degree of freedom, median (mean)", "CPU s")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, methods in figures.items():
        for method in ("cdff", "opencv"):
            row = methods[method]
            about_mean = f"{row['about_common_mean_deg']}°" if "about_common_mean_deg" in row else "–"
            squared = (
                f"{row['squared_error_median']} ({row['squared_error_mean']})"
                if "squared_error_mean" in row
                else "–"
            )
            lines.append(
                f"| {name} | {method} | {row['poses']} of {methods['pairs']} ({row['ok']}) | "
                f"{row['matches']} | {row['correct_percent']} % | {row['rotation_median_deg']}° | "
                f"{row['direction_median_deg']}° ({row['direction_max_deg']}°) | {about_mean} | {squared} | "
                f"{row['cpu_s']} |"
            )
    return "\n".join(lines)


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    return [
        RealRow(
            f"{name.replace('_', ' ')}, {row['pairs']} pairs: median error of the direction, mean NEES per "
            "degree of freedom (1 expected), CPU time",
            "",
            f"{_direction_error(row['cdff'])}, {row['cdff']['squared_error_mean']}, {row['cdff']['cpu_s']} s",
            f"OpenCV {_direction_error(row['opencv'])}, {row['opencv']['cpu_s']} s",
            "≤ OpenCV's error, ≤ 3, ≤ 2 × its time",
        )
        for name, row in figures.items()
        if isinstance(row, dict) and "cdff" in row and row["cdff"]["poses"]
    ]


def _direction_error(row: dict[str, Any]) -> str:
    """Return the median error of the direction, and that about the mean error of all methods if it is known.

    The mean contains the error of the reference that all methods have in common.
    """
    error = f"{row['direction_median_deg']}°"
    mean_deg = row.get("about_common_mean_deg")
    return error if mean_deg is None else f"{error} ({mean_deg}° about the common mean)"
