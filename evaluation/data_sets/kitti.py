# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on a KITTI folder: error metrics, a minimal OpenCV pipeline, errors of the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import FramePair
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.logs.formats.kitti.sequence import PAIR, TRUTH, kitti_log

FloatArray = NDArray[np.float64]
SEQUENCE = "kitti_stereo/KITTI_sequence_1"
SEGMENTS_M = (5.0, 10.0, 20.0, 50.0)
SEEDS = range(20)


def read(folder: Path) -> tuple[list[FramePair], FloatArray]:
    """Return the stereo pairs and the reference poses ``(n, 4, 4)`` of the left camera relative to the first
    one.
    """
    samples = list(kitti_log(folder).samples())
    pairs = [s.value for s in samples if s.stream == PAIR]
    return pairs, np.stack([s.value.transform.matrix for s in samples if s.stream == TRUTH])


def run_dfpc(pairs: Sequence[FramePair], seed: int = 0, **parameters: Any) -> FloatArray:
    """Return the poses ``(n, 4, 4)`` of the DFPC; a FAILED pair repeats the previous pose."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(parameters, DfpcContext(robot="kitti", seed=seed))
    poses: list[FloatArray] = []
    for i, pair in enumerate(pairs):
        for output in dfpc.step(Sample("stereo", pair.stamp_ns, i, pair, id=str(i))):
            poses.append(poses[-1] if output.value is None else output.value.transform.matrix)
    return np.stack(poses)


def run_opencv(pairs: Sequence[FramePair], seed: int = 0) -> FloatArray:
    """Return poses ``(n, 4, 4)`` by OpenCV: SGBM, goodFeaturesToTrack, Lucas-Kanade, solvePnPRansac."""
    cv2.setRNGSeed(seed)
    sgbm = cv2.StereoSGBM_create(0, 128, 5, 200, 800, 1, 63, 10, 100, 2)
    K, baseline_m, poses = np.array(pairs[0].camera_matrix), pairs[0].baseline, [np.eye(4)]
    for previous_pair, pair in pairwise(pairs):
        previous_image, image = np.array(previous_pair.left.image), np.array(pair.left.image)
        disparity = sgbm.compute(previous_image, np.array(previous_pair.right.image)) / 16.0
        corners = cv2.goodFeaturesToTrack(previous_image, 1500, 0.01, 8)
        tracked, status, _ = cv2.calcOpticalFlowPyrLK(
            previous_image, image, corners, None, winSize=(21, 21), maxLevel=4
        )
        p, q = corners[:, 0].astype(np.float64), tracked[:, 0].astype(np.float64)
        d = disparity[p[:, 1].astype(int), p[:, 0].astype(int)]
        valid = (status[:, 0] == 1) & (d > 2.0)
        z = K[0, 0] * baseline_m / d[valid]
        points = np.column_stack([(p[valid] - K[:2, 2]) / K[0, 0] * z[:, None], z])
        _, r, t, _ = cv2.solvePnPRansac(
            points, q[valid], K, None, iterationsCount=200, reprojectionError=1.0, flags=cv2.SOLVEPNP_SQPNP
        )
        poses.append(poses[-1] @ se3.inverse(se3.transform(se3.exp_so3(r[:, 0]), t[:, 0])))
    return np.stack(poses)


def path_lengths_m(truth: FloatArray) -> FloatArray:
    """Return the path length (n,) at each pose, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])


def end_percent(poses: FloatArray, truth: FloatArray) -> float:
    """Return the end error in per cent of the path length."""
    return float(100.0 * np.linalg.norm(poses[-1, :3, 3] - truth[-1, :3, 3]) / path_lengths_m(truth)[-1])


def measured_from(truth: FloatArray) -> int:
    """Return the index of the first measured pose of a reference trajectory.

    Poses of KITTI without GPS/IMU readings are interpolated: all their steps rotate by the same angle, within
    0.01 degrees. Measured steps differ by more.
    """
    rotations_rad = [se3.log_so3((se3.inverse(a) @ b)[:3, :3]) for a, b in pairwise(truth)]
    changes = np.linalg.norm(np.diff(rotations_rad, axis=0), axis=1)
    return int(np.argmax(changes > np.radians(0.01))) + 1 if changes[0] <= np.radians(0.01) else 0


def measured_percent(poses: FloatArray, truth: FloatArray) -> float:
    """Return the end error over the measured part of the reference, in per cent of its path length."""
    k = measured_from(truth)
    return end_percent(se3.inverse(poses[k]) @ poses[k:], se3.inverse(truth[k]) @ truth[k:])


def unmeasured_percent(poses: FloatArray, truth: FloatArray) -> float:
    """Return the end error caused by the unmeasured start alone, in per cent of the whole path length.

    The trajectory follows ``poses`` up to the first measured pose, and the reference motion afterwards.
    """
    k = measured_from(truth)
    return end_percent(np.concatenate([poses[:k], poses[k] @ se3.inverse(truth[k]) @ truth[k:]]), truth)


def rotation_aligned(poses: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the poses, rotated about the start to fit the reference best (Kabsch)."""
    U, _, Vt = np.linalg.svd(poses[:, :3, 3].T @ truth[:, :3, 3])
    T = np.eye(4)
    T[:3, :3] = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
    return np.asarray(T @ poses)


def segment_errors(poses: FloatArray, truth: FloatArray, length_m: float) -> FloatArray:
    """Return the translation error of each segment of ``length_m``, divided by the length of its path.

    The result has shape (m, 3); each row is in the frame of the first camera of its segment.
    """
    lengths_m, errors = path_lengths_m(truth), []
    for i in range(len(truth)):
        j = int(np.searchsorted(lengths_m, lengths_m[i] + length_m))
        if j < len(truth):
            estimated, true = se3.inverse(poses[i]) @ poses[j], se3.inverse(truth[i]) @ truth[j]
            errors.append((estimated - true)[:3, 3] / (lengths_m[j] - lengths_m[i]))
    return np.array(errors).reshape(-1, 3)


def segment_percent(poses: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Return the mean translation error for each segment length, per cent: KITTI's metric on shorter
    segments.
    """
    results = {length: segment_errors(poses, truth, length) for length in SEGMENTS_M}
    return {
        f"{length:g} m": round(float(100.0 * np.linalg.norm(errors, axis=1).mean()), 3)
        for length, errors in results.items()
        if len(errors)
    }


def kitti(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the end errors of all seeds, the segment errors, and the errors of other odometry methods."""
    pairs, truth = read(data / SEQUENCE)
    results = []
    for seed in SEEDS:
        progress(f"visual odometry: KITTI, seed {seed}")
        results.append(run_dfpc(pairs, seed))
    ends = [end_percent(poses, truth) for poses in results]
    progress("visual odometry: KITTI, other methods")
    other_methods = _other_methods(pairs, results[0])
    return {
        "data": SEQUENCE,
        "path_m": round(float(path_lengths_m(truth)[-1]), 2),
        "seeds": [SEEDS.start, SEEDS.stop - 1],
        "end_error_percent": error_summary(ends),
        "measured_from": measured_from(truth),
        "measured_m": round(
            float(path_lengths_m(truth)[-1] - path_lengths_m(truth)[measured_from(truth)]), 2
        ),
        "measured_end_error_percent": error_summary([measured_percent(p, truth) for p in results]),
        "unmeasured_start_percent": error_summary([unmeasured_percent(p, truth) for p in results]),
        "end_error_aligned_percent": error_summary(
            [end_percent(rotation_aligned(p, truth), truth) for p in results]
        ),
        "path_length_percent": error_summary(
            [100.0 * (path_lengths_m(p)[-1] / path_lengths_m(truth)[-1] - 1.0) for p in results]
        ),
        "segments_percent": segment_percent(results[0], truth),
        "segments_floor_percent": _floor(other_methods, truth),
        "methods": {
            name: {
                "end_error_percent": round(end_percent(poses, truth[::stride]), 3),
                "measured_percent": round(measured_percent(poses, truth[::stride]), 3),
                "unmeasured_start_percent": round(unmeasured_percent(poses, truth[::stride]), 3),
                "aligned_percent": round(
                    end_percent(rotation_aligned(poses, truth[::stride]), truth[::stride]), 3
                ),
                "end_error_m": [round(float(v), 3) for v in (poses[-1] - truth[::stride][-1])[:3, 3]],
            }
            for name, (stride, poses) in other_methods.items()
        },
    }


def _other_methods(pairs: list[FramePair], default_poses: FloatArray) -> dict[str, tuple[int, FloatArray]]:
    """Return the results of other odometry methods on the same images: name -> frame stride, poses."""
    rows = pairs[0].left.image.shape[0] // 2
    upper_halves = [
        FramePair.from_images(
            np.array(p.left.image)[:rows],
            np.array(p.right.image)[:rows],
            baseline_m=p.baseline,
            camera_matrix=np.array(p.camera_matrix),
            stamp_ns=p.stamp_ns,
        )
        for p in pairs
    ]
    return {
        "default": (1, default_poses),
        "without calibration refinement": (1, run_dfpc(pairs, refinement={"sigma_offset_px": 0.001})),
        "new keyframe below 30 % of points": (1, run_dfpc(pairs, keyframe_survival=0.3)),
        "window of two keyframes": (1, run_dfpc(pairs, window=2)),
        "window of three keyframes": (1, run_dfpc(pairs, window=3)),
        "window of five keyframes": (1, run_dfpc(pairs, window=5)),
        "FAST corners, OpenCV's tracker": (1, _open_cv_tracker(pairs)),
        "every second frame": (2, run_dfpc(pairs[::2])),
        "upper half of the images": (1, run_dfpc(upper_halves)),
        "OpenCV, minimal": (1, run_opencv(pairs)),
    }


def _open_cv_tracker(pairs: list[FramePair]) -> FloatArray:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="kitti"), "KeyframeOpenCv")
    outputs = [
        o for i, p in enumerate(pairs) for o in dfpc.step(Sample("stereo", p.stamp_ns, i, p, id=str(i)))
    ]
    return np.stack([o.value.transform.matrix for o in outputs])


def _floor(other_methods: dict[str, tuple[int, FloatArray]], truth: FloatArray) -> dict[str, float]:
    """Return the mean length of the segment error common to all methods at full rate, per cent.

    It is an estimate of the error of the reference.
    """
    full_rate = [poses for stride, poses in other_methods.values() if stride == 1]
    floor = {}
    for length in SEGMENTS_M:
        common_errors = np.mean([segment_errors(poses, truth, length) for poses in full_rate], axis=0)
        floor[f"{length:g} m"] = round(float(100.0 * np.linalg.norm(common_errors, axis=1).mean()), 3)
    return floor
