# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare visual_odometry_sparse on a KITTI folder with a minimal OpenCV pipeline: accuracy and time.

    python benchmarks/visual_odometry.py [--out FILE] [--figure FILE.svg] [--data FOLDER] [--seeds N]
    [--rounds N]

The pipeline (``peer``) uses SGBM disparity, goodFeaturesToTrack, calcOpticalFlowPyrLK and solvePnPRansac
(SQPnP) from frame to frame, with a seed. Rounds of the DFPC and the pipeline alternate; times exclude reading
and decoding images. The end error is the distance between the last estimated and true position relative to
the length of the true path; both trajectories are relative to the pose of their first camera.
``floor_percent`` is the end error after removal of the best constant rotation between the trajectories, which
is an error of the reference that no odometry can avoid.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _report import write_report

from cdff_common.types import FramePair
from evaluation.data_sets.kitti import (
    FloatArray,
    end_percent,
    path_lengths_m,
    read,
    rotation_aligned,
    run_dfpc,
    run_opencv,
    segment_percent,
)

ROOT = Path(__file__).resolve().parents[1]


def summary(all_poses: list[FloatArray], truth: FloatArray) -> dict[str, Any]:
    """Return the errors over all seeds."""
    ends = [end_percent(poses, truth) for poses in all_poses]
    steps = [path_lengths_m(poses)[-1] / path_lengths_m(truth)[-1] - 1.0 for poses in all_poses]
    return {
        "seeds": len(ends),
        "end_percent": {
            "median": round(statistics.median(ends), 3),
            "worst": round(max(ends), 3),
            "best": round(min(ends), 3),
        },
        "floor_percent_median": round(
            statistics.median(end_percent(rotation_aligned(p, truth), truth) for p in all_poses), 3
        ),
        "path_length_percent_median": round(100.0 * statistics.median(steps), 3),
        "ate_rmse_m_median": round(
            statistics.median(
                float(np.sqrt(np.mean(np.sum((p - truth)[:, :3, 3] ** 2, axis=1)))) for p in all_poses
            ),
            3,
        ),
        "segments_percent_seed0": segment_percent(all_poses[0], truth),
    }


def draw(path: Path, estimates: dict[str, FloatArray], truth: FloatArray) -> None:
    """Draw the estimates and the reference from above and from the side, as SVG."""
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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    root = Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared" / "data")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--data", type=Path, default=root / "kitti_stereo" / "KITTI_sequence_1")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument(
        "--rounds", type=int, default=5, help="rounds of time measurement; each also counts as a seed"
    )
    args = parser.parse_args()
    if not args.data.is_dir():
        print(f"{args.data} not found; set CDFF_DATA or --data")
        return 1
    pairs, truth = read(args.data)
    pipelines: dict[str, Callable[[list[FramePair], int], FloatArray]] = {
        "ours": run_dfpc,
        "peer": run_opencv,
    }
    poses: dict[str, list[FloatArray]] = {name: [] for name in pipelines}
    cpu: dict[str, list[float]] = {name: [] for name in pipelines}
    wall: dict[str, list[float]] = {name: [] for name in pipelines}
    run_dfpc(pairs[:3], 0)  # compile, or load the compiled code
    for seed in range(args.seeds):
        for name, pipeline in pipelines.items():
            if name == "peer" and seed >= args.rounds:
                continue
            start_cpu_s, start_wall_s = time.process_time(), time.perf_counter()
            poses[name].append(pipeline(pairs, seed))
            if seed < args.rounds:
                cpu[name].append(1e3 * (time.process_time() - start_cpu_s) / len(pairs))
                wall[name].append(1e3 * (time.perf_counter() - start_wall_s) / len(pairs))
    report: dict[str, Any] = {
        "benchmark": "visual_odometry",
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "opencv_threads": cv2.getNumThreads(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "data": args.data.name,
        "frames": len(pairs),
        "size": list(pairs[0].left.image.shape),
        "path_m": round(float(path_lengths_m(truth)[-1]), 2),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }
    for name in pipelines:
        times = {"cpu_ms_per_frame": round(statistics.median(cpu[name]), 1)}
        times["wall_ms_per_frame"] = round(statistics.median(wall[name]), 1)
        report[name] = summary(poses[name], truth) | times
    write_report(report, args.out)
    if args.figure:
        draw(
            args.figure,
            {"visual_odometry_sparse": poses["ours"][0], "OpenCV, minimal": poses["peer"][0]},
            truth,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
