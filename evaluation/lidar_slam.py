# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate lidar SLAM and its loop closures on simulated traverses, and its poses on real sweeps.

The traverses are those of ``deploy/simulation/lidar_traverse.yaml``. Related evaluations: ``lidar_slam_peer``
(kiss-icp on the same sweeps), ``lidar_slam_covariance`` (short drives), ``lidar_slam_ground`` (plains, lidars
with few points), ``lidar_slam_laps`` (size of the map).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from cdff_core.dfpcs.lidar_slam.compound import LidarSlam
from cdff_core.dfpcs.lidar_slam.loop_closure import LoopCloser
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import bounds
from cdff_dev.simulate.scenario import load_scenario
from evaluation.data_sets.clouds import kitti_pair
from evaluation.runs.lidar_slam import SEEDS, Run, drive, errors, times
from evaluation.runs.lidar_slam_page import draw, table

__all__ = ["draw", "drive", "evaluate", "table"]

#: Number of pairs of distant keyframes that are verified.
PAIRS = 500
#: Distance beyond which a pair of keyframes is no loop; error limits of a correct registration.
NO_LOOP_M, CORRECT_M, CORRECT_DEG = 20.0, 0.3, 3.0


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results on simulated traverses and real sweeps."""
    figures: dict[str, Any] = {"simulated": {}, "real": {"kitti_velodyne": kitti(data / "kitti_velodyne")}}
    for seed in SEEDS:
        run = drive(load_scenario("lidar_traverse", seed), progress)
        figures["simulated"][f"lidar_traverse, seed {seed}"] = traverse(run)
        if seed == SEEDS[0]:
            figures["simulated"]["loops"] = loops(run, progress)
    return figures


def traverse(run: Run) -> dict[str, Any]:
    """Return the errors of odometry, published poses and final trajectory, the cost and the map size."""
    odometry, online, final = run.track("odometry"), run.track("pose"), run.trajectory()
    metrics = run.products["graph"][-1].header.quality.metrics
    statuses = [p.header.quality.status for p in run.products["pose"]]
    loop_errors = _loop_errors(run)
    return {
        "path_length_m": round(float(run.reference(odometry).distances_m[-1]), 1),
        "sweeps": len(run.cpu_s),
        "odometry": errors(odometry, run),
        "pose as published": errors(online, run),
        "trajectory at the end": errors(final, run),
        "loops": {k: int(metrics[k]) for k in ("loops", "loops_rejected", "refused_loops")} | loop_errors,
        "keyframes": int(metrics["keyframes"]),
        "cloud_mb": round(metrics["cloud_mb"], 1),
        "degraded": sum(s is Status.DEGRADED for s in statuses),
        "failed": sum(s is Status.FAILED for s in statuses),
        "cpu_s_per_sweep": times(run.cpu_s),
        "wall_s_per_sweep": times(run.wall_s),
    }


def _loop_errors(run: Run) -> dict[str, Any]:
    """Return the errors of the loop closures in the graph."""
    keyframes, errors_m, errors_deg = run.node.keyframes.keyframes, [], []
    for a, b, T_a_b in run.node.keyframes.loop_closures():
        T = se3.inverse(run.truth[keyframes[a].stamp_ns]) @ run.truth[keyframes[b].stamp_ns]
        E = se3.inverse(T) @ T_a_b.matrix
        errors_m.append(float(np.linalg.norm(E[:3, 3])))
        errors_deg.append(float(np.degrees(se3.rotation_angle(E[:3, :3]))))
    return {"error_m": error_summary(errors_m), "error_deg": error_summary(errors_deg)}


def loops(run: Run, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return recall and precision of loop detection and verification over all pairs of keyframes.

    The pose graph is not used. Recall of detection: fraction of the pairs within 5 m that are proposed, at
    the configured similarity. Precision: fraction of the proposed pairs that are within 10 m. Neighbours on
    the path are included. Verification starts from the guess of the detection; its results are counted for
    pairs within 5 m and for pairs farther apart than 20 m.
    """
    from cdff_core.dfns.loop_detection.interface import LoopDetectionInputs

    keyframe_map = run.node.keyframes
    detect = Registry.default().make_dfn("loop_detection", "HeightContext")
    detect.configure({"max_candidates": 1000})
    keys = [k for k in keyframe_map.keyframes if len(keyframe_map.keyframes[k].points_m) > 1000]
    poses = {k: run.truth[keyframe_map.keyframes[k].stamp_ns] for k in keys}
    descriptions = {
        k: detect.process(
            LoopDetectionInputs(points=np.asarray(keyframe_map.keyframes[k].points_m, np.float64))
        )
        for k in keys
    }
    proposals: dict[tuple[int, int], FloatArray] = {}
    for k in keys:
        others = [o for o in keys if o != k]
        database = np.stack([descriptions[o].descriptor for o in others])
        outputs = detect.process(
            LoopDetectionInputs(
                points=np.asarray(keyframe_map.keyframes[k].points_m, np.float64), database=database
            )
        )
        proposals |= {
            (others[int(i)], k): T for i, T in zip(outputs.candidates, outputs.transforms, strict=True)
        }

    def distance_m(first: int, second: int) -> float:
        return float(np.linalg.norm(poses[first][:3, 3] - poses[second][:3, 3]))

    near = [(a, b) for a in keys for b in keys if a != b and distance_m(a, b) < 5.0]
    near_proposals = sum(pair in proposals for pair in near)
    close_proposals = sum(distance_m(*pair) < 10.0 for pair in proposals)
    rng = np.random.default_rng(0)
    far = [(a, b) for a in keys for b in keys if distance_m(a, b) > NO_LOOP_M]
    far = [far[i] for i in rng.choice(len(far), min(PAIRS, len(far)), replace=False)]
    closer = LoopCloser(run.node, run.node.config.loops)
    # Numbers of correct, wrong and refused verifications.
    counts = {"near": [0, 0, 0], "far": [0, 0, 0]}
    for kind, pairs in (("near", near), ("far", far)):
        for n, (a, b) in enumerate(pairs):
            progress(f"lidar slam: verification, {kind} pair {n}")
            loop = closer.verify(keyframe_map, a, b, proposals.get((a, b), np.eye(4)), {})
            E = None if loop is None else se3.inverse(se3.inverse(poses[a]) @ poses[b]) @ loop.T.matrix
            correct = E is not None and np.linalg.norm(E[:3, 3]) < CORRECT_M
            correct = correct and np.degrees(se3.rotation_angle(E[:3, :3])) < CORRECT_DEG
            counts[kind][0 if correct else 2 if loop is None else 1] += 1
    return {
        "keyframes": len(keys),
        "pairs": len(keys) * (len(keys) - 1),
        "detection": {
            "pairs_within_5_m": len(near),
            "proposed": near_proposals,
            "recall_95": bounds(near_proposals, len(near)),
            "proposed_in_total": len(proposals),
            "of_these_within_10_m": close_proposals,
            "precision_95": bounds(close_proposals, max(len(proposals), 1)),
        },
        "verification": {
            kind: {
                "trials": sum(v),
                "correct": v[0],
                "wrong": v[1],
                "refused": v[2],
                "wrong_95": bounds(v[1], sum(v)),
            }
            for kind, v in counts.items()
        },
    }


def kitti(folder: Path) -> dict[str, Any]:
    """Return the errors of one pair of sweeps with ground truth, and the quality of three sweeps without."""
    *_, T_94_95 = kitti_pair(folder.parent)
    results = {}
    for name, files in _sequences(folder).items():
        node: LidarSlam = Registry.default().make_dfpc("lidar_slam")  # type: ignore[assignment]
        node.configure(None)
        poses = []
        for i, path in enumerate(files):
            points = read_kitti_bin(path).points_m.astype(np.float32)
            stamp_ns = i * 100_000_000
            scan = LidarScan.from_arrays(
                points,
                np.zeros(len(points), np.uint32),
                frame="robot/lidar",
                t0_ns=stamp_ns,
                t1_ns=stamp_ns,
            )
            poses += [o for o in node.step(Sample("scan", stamp_ns, i, scan)) if o.port == "odometry"]
        last = poses[-1]
        results[name] = {
            "status": str(last.quality.status),
            "reasons": list(last.quality.reasons),
            "inlier_ratio": round(last.quality.metrics["inlier_ratio"], 3),
        }
        if last.value is not None:
            results[name]["moved_m"] = round(float(np.linalg.norm(last.value.transform.matrix[:3, 3])), 3)
        if name == "94, 95" and last.value is not None:
            E = se3.inverse(T_94_95) @ last.value.transform.matrix
            results[name]["error_m"] = round(float(np.linalg.norm(E[:3, 3])), 4)
            results[name]["error_deg"] = round(float(np.degrees(se3.rotation_angle(E[:3, :3]))), 4)
    return results


def _sequences(folder: Path) -> dict[str, list[Path]]:
    files = sorted(folder.glob("*.bin"))
    pair = [f for f in files if f.stem in ("000094", "000095")]
    others = [f for f in files if f not in pair]
    return {"94, 95": pair} | ({", ".join(str(int(f.stem)) for f in others): others} if others else {})
