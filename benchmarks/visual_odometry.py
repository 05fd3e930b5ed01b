# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy and time of visual_odometry_sparse on a KITTI folder, beside a minimal OpenCV pipeline in the same run.

    python benchmarks/visual_odometry.py [--out FILE] [--figure FILE.svg] [--data FOLDER] [--seeds N] [--rounds N]

The peer is SGBM disparity, goodFeaturesToTrack, calcOpticalFlowPyrLK and solvePnPRansac (SQPnP), frame to frame, with
OpenCV's random generator seeded. Rounds of ours and the peer alternate; reading and decoding images is not timed. End
error is the distance between the last estimated and true position over the length of the true path, both starting at
the first camera. ``floor_percent`` is what remains of it when the best constant rotation between the two frames is
taken out: the truth's own start and mounting, which no odometry can know.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import statistics
import time
from collections.abc import Callable
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

FloatArray = NDArray[np.float64]
Poses = FloatArray
ROOT = Path(__file__).resolve().parents[1]
SEGMENTS_M = (5.0, 10.0, 20.0, 50.0)


def ours(pairs: list[FramePair], seed: int) -> Poses:
    """Poses (n, 4, 4) of the DFPC."""
    dfpc = Registry.default().make_dfpc("visual_odometry_sparse")
    dfpc.configure(None, DfpcContext(robot="kitti", seed=seed))
    outputs = [o for i, p in enumerate(pairs) for o in dfpc.step(Sample("stereo", p.stamp_ns, i, p, id=str(i)))]
    return np.stack([o.value.transform.matrix for o in outputs])


def peer(pairs: list[FramePair], seed: int) -> Poses:
    """Poses (n, 4, 4) of the minimal OpenCV pipeline."""
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


def lengths(truth: Poses) -> FloatArray:
    """Path length (n,) at each pose, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])


def end_percent(poses: Poses, truth: Poses) -> float:
    """End error in per cent of the path."""
    return float(100.0 * np.linalg.norm(poses[-1, :3, 3] - truth[-1, :3, 3]) / lengths(truth)[-1])


def floor_percent(poses: Poses, truth: Poses) -> float:
    """End error after the best constant rotation about the start (Kabsch), in per cent of the path."""
    p, q = poses[:, :3, 3], truth[:, :3, 3]
    U, _, Vt = np.linalg.svd(p.T @ q)
    R = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
    return float(100.0 * np.linalg.norm(R @ p[-1] - q[-1]) / lengths(truth)[-1])


def segment_percent(poses: Poses, truth: Poses) -> dict[str, float]:
    """Mean translation error over segments of each length, per cent, as KITTI counts it but for rover distances."""
    along, result = lengths(truth), {}
    for length in SEGMENTS_M:
        errors = []
        for i in range(len(truth)):
            j = int(np.searchsorted(along, along[i] + length))
            if j < len(truth):
                estimated, true = se3.inverse(poses[i]) @ poses[j], se3.inverse(truth[i]) @ truth[j]
                errors.append(100.0 * np.linalg.norm((se3.inverse(true) @ estimated)[:3, 3]) / (along[j] - along[i]))
        if errors:
            result[f"{length:g}m"] = round(float(np.mean(errors)), 3)
    return result


def summary(all_poses: list[Poses], truth: Poses) -> dict[str, Any]:
    """Accuracy over seeds."""
    ends = [end_percent(poses, truth) for poses in all_poses]
    steps = [lengths(poses)[-1] / lengths(truth)[-1] - 1.0 for poses in all_poses]
    return {
        "seeds": len(ends),
        "end_percent": {
            "median": round(statistics.median(ends), 3), "worst": round(max(ends), 3), "best": round(min(ends), 3)
        },
        "floor_percent_median": round(statistics.median(floor_percent(p, truth) for p in all_poses), 3),
        "path_length_percent_median": round(100.0 * statistics.median(steps), 3),
        "ate_rmse_m_median": round(
            statistics.median(
                float(np.sqrt(np.mean(np.sum((p - truth)[:, :3, 3] ** 2, axis=1)))) for p in all_poses
            ), 3
        ),
        "segments_percent_seed0": segment_percent(all_poses[0], truth),
    }  # fmt: skip


def draw(path: Path, estimates: dict[str, Poses], truth: Poses) -> None:
    """The drive from above and from the side, with the truth."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "visual_odometry"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 1, figsize=(7.0, 4.2), sharex=True)
    for axis, column, label in ((axes[0], 0, "right (m)"), (axes[1], 1, "down (m)")):
        axis.plot(truth[:, 2, 3], truth[:, column, 3], "k--", label="truth (GPS/IMU)")
        for name, poses in estimates.items():
            axis.plot(poses[:, 2, 3], poses[:, column, 3], label=name)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[1].invert_yaxis()
    axes[1].set_xlabel("forward (m); the two vertical axes are stretched")
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def main() -> int:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    root = Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared" / "data")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--data", type=Path, default=root / "kitti_stereo" / "KITTI_sequence_1")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=5, help="of time measurement; each also serves as a seed")
    args = parser.parse_args()
    if not args.data.is_dir():
        print(f"{args.data} not found; set CDFF_DATA or --data")
        return 1
    samples = list(open_kitti(args.data).samples())
    pairs = [s.value for s in samples if s.stream == PAIR]
    truth = np.stack([s.value.transform.matrix for s in samples if s.stream == TRUTH])
    pipelines: dict[str, Callable[[list[FramePair], int], Poses]] = {"ours": ours, "peer": peer}
    poses: dict[str, list[Poses]] = {name: [] for name in pipelines}
    cpu: dict[str, list[float]] = {name: [] for name in pipelines}
    wall: dict[str, list[float]] = {name: [] for name in pipelines}
    ours(pairs[:3], 0)  # compile, or load what was compiled
    for seed in range(args.seeds):
        for name, pipeline in pipelines.items():
            if name == "peer" and seed >= args.rounds:
                continue
            cpu0, wall0 = time.process_time(), time.perf_counter()
            poses[name].append(pipeline(pairs, seed))
            if seed < args.rounds:
                cpu[name].append(1e3 * (time.process_time() - cpu0) / len(pairs))
                wall[name].append(1e3 * (time.perf_counter() - wall0) / len(pairs))
    report: dict[str, Any] = {
        "benchmark": "visual_odometry", "python": platform.python_version(), "opencv": cv2.__version__,
        "opencv_threads": cv2.getNumThreads(), "cores": os.cpu_count(), "load": round(os.getloadavg()[0], 1),
        "data": args.data.name, "frames": len(pairs), "size": list(pairs[0].left.image.shape),
        "path_m": round(float(lengths(truth)[-1]), 2),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }  # fmt: skip
    for name in pipelines:
        times = {"cpu_ms_per_frame": round(statistics.median(cpu[name]), 1)}
        times["wall_ms_per_frame"] = round(statistics.median(wall[name]), 1)
        report[name] = summary(poses[name], truth) | times
    text = json.dumps(report, indent=2)
    print(text)
    if args.out:
        args.out.write_text(text + "\n", encoding="utf-8")
    if args.figure:
        draw(args.figure, {"visual_odometry_sparse": poses["ours"][0], "OpenCV, minimal": poses["peer"][0]}, truth)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
