# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on a KITTI folder: how errors are counted, a minimal OpenCV pipeline, the truth's floor."""

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
from cdff_dev.convert.kitti import PAIR, TRUTH, open_kitti
from cdff_dev.evaluate.record import spread

FloatArray = NDArray[np.float64]
SEQUENCE = "kitti_stereo/KITTI_sequence_1"
SEGMENTS_M = (5.0, 10.0, 20.0, 50.0)
SEEDS = range(20)


def read(folder: Path) -> tuple[list[FramePair], FloatArray]:
    """Pairs, and the true poses ``(n, 4, 4)`` of the left camera in its first frame."""
    samples = list(open_kitti(folder).samples())
    pairs = [s.value for s in samples if s.stream == PAIR]
    return pairs, np.stack([s.value.transform.matrix for s in samples if s.stream == TRUTH])


def ours(pairs: Sequence[FramePair], seed: int = 0, **parameters: Any) -> FloatArray:
    """Poses ``(n, 4, 4)`` of the DFPC; one that is FAILED repeats the last."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(parameters, DfpcContext(robot="kitti", seed=seed))
    poses: list[FloatArray] = []
    for i, pair in enumerate(pairs):
        for output in dfpc.step(Sample("stereo", pair.stamp_ns, i, pair, id=str(i))):
            poses.append(poses[-1] if output.value is None else output.value.transform.matrix)
    return np.stack(poses)


def peer(pairs: Sequence[FramePair], seed: int = 0) -> FloatArray:
    """Poses ``(n, 4, 4)`` of SGBM, goodFeaturesToTrack, calcOpticalFlowPyrLK and solvePnPRansac (SQPnP)."""
    cv2.setRNGSeed(seed)
    sgbm = cv2.StereoSGBM_create(0, 128, 5, 200, 800, 1, 63, 10, 100, 2)
    K, baseline_m, poses = np.array(pairs[0].camera_matrix), pairs[0].baseline, [np.eye(4)]
    for first, second in pairwise(pairs):
        before, after = np.array(first.left.image), np.array(second.left.image)
        disparity = sgbm.compute(before, np.array(first.right.image)) / 16.0
        corners = cv2.goodFeaturesToTrack(before, 1500, 0.01, 8)
        tracked, status, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, winSize=(21, 21), maxLevel=4)
        p, q = corners[:, 0].astype(np.float64), tracked[:, 0].astype(np.float64)
        d = disparity[p[:, 1].astype(int), p[:, 0].astype(int)]
        good = (status[:, 0] == 1) & (d > 2.0)
        z = K[0, 0] * baseline_m / d[good]
        points = np.column_stack([(p[good] - K[:2, 2]) / K[0, 0] * z[:, None], z])
        _, r, t, _ = cv2.solvePnPRansac(
            points, q[good], K, None, iterationsCount=200, reprojectionError=1.0, flags=cv2.SOLVEPNP_SQPNP
        )
        poses.append(poses[-1] @ se3.inverse(se3.transform(se3.exp_so3(r[:, 0]), t[:, 0])))
    return np.stack(poses)


def lengths(truth: FloatArray) -> FloatArray:
    """Path length (n,) at each pose, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])


def end_percent(poses: FloatArray, truth: FloatArray) -> float:
    """End error in per cent of the path."""
    return float(100.0 * np.linalg.norm(poses[-1, :3, 3] - truth[-1, :3, 3]) / lengths(truth)[-1])


def measured_from(truth: FloatArray) -> int:
    """First pose of a truth that was measured: before it, all steps turn by the same angle to 0.01 degrees.

    Where GPS/IMU readings are missing, KITTI's poses are interpolated; a measured step differs from the next by more.
    """
    turns = [se3.log_so3((se3.inverse(a) @ b)[:3, :3]) for a, b in pairwise(truth)]
    changes = np.linalg.norm(np.diff(turns, axis=0), axis=1)
    return int(np.argmax(changes > np.radians(0.01))) + 1 if changes[0] <= np.radians(0.01) else 0


def measured_percent(poses: FloatArray, truth: FloatArray) -> float:
    """End error over the measured part of the truth, in per cent of it."""
    k = measured_from(truth)
    return end_percent(se3.inverse(poses[k]) @ poses[k:], se3.inverse(truth[k]) @ truth[k:])


def unmeasured_percent(poses: FloatArray, truth: FloatArray) -> float:
    """End error, in per cent of the whole path, of moving as the truth does where it was measured, as ``poses`` before.

    So much the end is off by the start alone, however good an odometry is afterwards.
    """
    k = measured_from(truth)
    return end_percent(np.concatenate([poses[:k], poses[k] @ se3.inverse(truth[k]) @ truth[k:]]), truth)


def turned(poses: FloatArray, truth: FloatArray) -> FloatArray:
    """The poses after the constant rotation about the start that fits them best to the truth (Kabsch)."""
    U, _, Vt = np.linalg.svd(poses[:, :3, 3].T @ truth[:, :3, 3])
    T = np.eye(4)
    T[:3, :3] = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
    return np.asarray(T @ poses)


def segment_errors(poses: FloatArray, truth: FloatArray, length_m: float) -> FloatArray:
    """Translation errors (m, 3) over all segments of a length, in its first camera, as shares of the way."""
    along, errors = lengths(truth), []
    for i in range(len(truth)):
        j = int(np.searchsorted(along, along[i] + length_m))
        if j < len(truth):
            estimated, true = se3.inverse(poses[i]) @ poses[j], se3.inverse(truth[i]) @ truth[j]
            errors.append((estimated - true)[:3, 3] / (along[j] - along[i]))
    return np.array(errors).reshape(-1, 3)


def segment_percent(poses: FloatArray, truth: FloatArray) -> dict[str, float]:
    """Mean translation error over segments of each length, per cent, as KITTI counts it but for rover distances."""
    found = {length: segment_errors(poses, truth, length) for length in SEGMENTS_M}
    return {
        f"{length:g} m": round(float(100.0 * np.linalg.norm(errors, axis=1).mean()), 3)
        for length, errors in found.items() if len(errors)
    }  # fmt: skip


def kitti(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """End errors over the seeds, segments, and what several other ways of looking at the same images leave."""
    pairs, truth = read(data / SEQUENCE)
    found = []
    for seed in SEEDS:
        progress(f"visual odometry: KITTI, seed {seed}")
        found.append(ours(pairs, seed))
    ends = [end_percent(poses, truth) for poses in found]
    progress("visual odometry: KITTI, other ways")
    others = _other_ways(pairs, found[0])
    return {
        "data": SEQUENCE,
        "path_m": round(float(lengths(truth)[-1]), 2),
        "seeds": [SEEDS.start, SEEDS.stop - 1],
        "end_error_percent": spread(ends),
        "measured_from": measured_from(truth),
        "measured_m": round(float(lengths(truth)[-1] - lengths(truth)[measured_from(truth)]), 2),
        "measured_end_error_percent": spread([measured_percent(p, truth) for p in found]),
        "unmeasured_start_percent": spread([unmeasured_percent(p, truth) for p in found]),
        "end_error_turned_percent": spread([end_percent(turned(p, truth), truth) for p in found]),
        "path_length_percent": spread([100.0 * (lengths(p)[-1] / lengths(truth)[-1] - 1.0) for p in found]),
        "segments_percent": segment_percent(found[0], truth),
        "segments_floor_percent": _floor(others, truth),
        "ways": {
            name: {
                "end_error_percent": round(end_percent(poses, truth[::stride]), 3),
                "measured_percent": round(measured_percent(poses, truth[::stride]), 3),
                "unmeasured_start_percent": round(unmeasured_percent(poses, truth[::stride]), 3),
                "turned_percent": round(end_percent(turned(poses, truth[::stride]), truth[::stride]), 3),
                "end_error_m": [round(float(v), 3) for v in (poses[-1] - truth[::stride][-1])[:3, 3]],
            }
            for name, (stride, poses) in others.items()
        },
    }  # fmt: skip


def _other_ways(pairs: list[FramePair], first: FloatArray) -> dict[str, tuple[int, FloatArray]]:
    """Odometries of the same drive that share little but its images: name -> stride of the frames, poses."""
    rows = pairs[0].left.image.shape[0] // 2
    upper = [
        FramePair.from_images(
            np.array(p.left.image)[:rows], np.array(p.right.image)[:rows], baseline_m=p.baseline,
            camera_matrix=np.array(p.camera_matrix), stamp_ns=p.stamp_ns,
        )
        for p in pairs
    ]  # fmt: skip
    return {
        "as it is": (1, first),
        "without calibration refinement": (1, ours(pairs, refinement={"sigma_offset_px": 0.001})),
        "key frames kept twice as long": (1, ours(pairs, keyframe_survival=0.3)),
        "window of two key frames": (1, ours(pairs, window=2)),
        "window of three key frames": (1, ours(pairs, window=3)),
        "window of five key frames": (1, ours(pairs, window=5)),
        "FAST corners, OpenCV's tracker": (1, _open_cv_tracker(pairs)),
        "every second frame": (2, ours(pairs[::2])),
        "upper half of the images": (1, ours(upper)),
        "OpenCV, minimal": (1, peer(pairs)),
    }


def _open_cv_tracker(pairs: list[FramePair]) -> FloatArray:
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="kitti"), "KeyframeOpenCv")
    outputs = [o for i, p in enumerate(pairs) for o in dfpc.step(Sample("stereo", p.stamp_ns, i, p, id=str(i)))]
    return np.stack([o.value.transform.matrix for o in outputs])


def _floor(others: dict[str, tuple[int, FloatArray]], truth: FloatArray) -> dict[str, float]:
    """Mean length of the error that all ways at full rate have in common on a segment, per cent: the truth's own."""
    full = [poses for stride, poses in others.values() if stride == 1]
    floor = {}
    for length in SEGMENTS_M:
        shared = np.mean([segment_errors(poses, truth, length) for poses in full], axis=0)
        floor[f"{length:g} m"] = round(float(100.0 * np.linalg.norm(shared, axis=1).mean()), 3)
    return floor
