# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar SLAM against truth: simulated traverses, loops; real sweeps as they are.

Simulated: ``deploy/simulation/lidar_traverse.yaml``. Beside it: ``lidar_slam_peer`` (kiss-icp on the same sweeps),
``lidar_slam_covariance`` (short drives), ``lidar_slam_ground`` (plains, sparse lidars), ``lidar_slam_laps``.
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
from cdff_core.dfpcs.lidar_slam.closing import LoopCloser
from cdff_core.dfpcs.lidar_slam.compound import LidarSlam
from cdff_dev.evaluate._lidar_slam_drive import SEEDS, Run, drive, errors, times
from cdff_dev.evaluate._lidar_slam_page import draw, table
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import bounds
from cdff_dev.simulate.scenario import load_scenario

__all__ = ["draw", "drive", "evaluate", "table"]

PAIRS = 500
#: Places so far apart are not one; a registration of them is right within these of the truth.
APART_M, RIGHT_M, RIGHT_DEG = 20.0, 0.3, 3.0
KITTI_CALIBRATION = np.array(
    [
        [4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02],
        [-7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02],
        [9.999738645903e-01, 4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """All figures."""
    figures: dict[str, Any] = {"simulated": {}, "real": {"kitti_velodyne": kitti(data / "kitti_velodyne")}}
    for seed in SEEDS:
        run = drive(load_scenario("lidar_traverse", seed), progress)
        figures["simulated"][f"lidar_traverse, seed {seed}"] = traverse(run)
        if seed == SEEDS[0]:
            figures["simulated"]["loops"] = loops(run, progress)
    return figures


def traverse(run: Run) -> dict[str, Any]:
    """Drift of the odometry, errors of the map's poses, cost and memory."""
    odometry, online, final = run.track("odometry"), run.track("pose"), run.trajectory()
    metrics = run.products["graph"][-1].header.quality.metrics
    statuses = [p.header.quality.status for p in run.products["pose"]]
    loop_errors = _loop_errors(run)
    return {
        "way_m": round(float(run.reference(odometry).distances_m[-1]), 1),
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
    """How far the loops in the graph are from the truth."""
    places, off_m, off_deg = run.node.places, [], []
    for (a, b, kind), edge in places.edges.items():
        if kind == 1:
            T = se3.inverse(run.truth[places.frames[a].stamp_ns]) @ run.truth[places.frames[b].stamp_ns]
            E = se3.inverse(T) @ edge.T.matrix
            off_m.append(float(np.linalg.norm(E[:3, 3])))
            off_deg.append(float(np.degrees(se3.rotation_angle(E[:3, :3]))))
    return {"error_m": spread(off_m), "error_deg": spread(off_deg)}


def loops(run: Run, progress: Callable[[str], None]) -> dict[str, Any]:
    """Detection over all pairs of key frames; verification of pairs without the graph's help.

    Detection: of a pair within 5 m, does the one name the other (at the configured similarity)? Of what is named, how
    much lies within 10 m? Neighbours on the way count as any other. Verification from the guess of detection: of pairs
    within 5 m, how many come out right; of pairs farther apart than 20 m, how many come out wrong.
    """
    from cdff_core.dfns.loop_detection._interface import LoopDetectionInputs

    places = run.node.places
    detect = Registry.default().make_dfn("loop_detection", "HeightContext")
    detect.configure({"max_candidates": 1000})
    keys = [k for k in places.frames if len(places.frames[k].points_m) > 1000]
    position = {k: run.truth[places.frames[k].stamp_ns] for k in keys}
    seen = {k: detect.process(LoopDetectionInputs(np.asarray(places.frames[k].points_m, np.float64))) for k in keys}
    named: dict[tuple[int, int], FloatArray] = {}
    for k in keys:
        others = [o for o in keys if o != k]
        database = np.stack([seen[o].descriptor for o in others])
        found = detect.process(LoopDetectionInputs(np.asarray(places.frames[k].points_m, np.float64), database))
        named |= {(others[int(i)], k): T for i, T in zip(found.candidates, found.transforms, strict=True)}

    def apart(a: int, b: int) -> float:
        return float(np.linalg.norm(position[a][:3, 3] - position[b][:3, 3]))

    same = [(a, b) for a in keys for b in keys if a != b and apart(a, b) < 5.0]
    hits = sum(pair in named for pair in same)
    close = sum(apart(*pair) < 10.0 for pair in named)
    rng = np.random.default_rng(0)
    far = [(a, b) for a in keys for b in keys if apart(a, b) > APART_M]
    far = [far[i] for i in rng.choice(len(far), min(PAIRS, len(far)), replace=False)]
    closer = LoopCloser(run.node, run.node.config)
    verdicts = {"near": [0, 0, 0], "far": [0, 0, 0]}
    for what, pairs in (("near", same), ("far", far)):
        for n, (a, b) in enumerate(pairs):
            progress(f"lidar slam: verification, {what} pair {n}")
            loop = closer.verified(places, a, b, named.get((a, b), np.eye(4)), {})
            E = None if loop is None else se3.inverse(se3.inverse(position[a]) @ position[b]) @ loop.T.matrix
            right = E is not None and np.linalg.norm(E[:3, 3]) < RIGHT_M
            right = right and np.degrees(se3.rotation_angle(E[:3, :3])) < RIGHT_DEG
            verdicts[what][0 if right else 2 if loop is None else 1] += 1
    return {
        "keyframes": len(keys), "pairs": len(keys) * (len(keys) - 1),
        "detection": {
            "pairs_within_5_m": len(same), "named": hits, "recall_95": bounds(hits, len(same)),
            "named_in_all": len(named), "of_these_within_10_m": close,
            "precision_95": bounds(close, max(len(named), 1)),
        },
        "verification": {
            what: {"trials": sum(v), "right": v[0], "wrong": v[1], "refused": v[2], "wrong_95": bounds(v[1], sum(v))}
            for what, v in verdicts.items()
        },
    }  # fmt: skip


def kitti(folder: Path) -> dict[str, Any]:
    """One pair with truth, and three sweeps without: nothing but what it says of itself."""
    rows = np.loadtxt(folder / "00_poses_cam0.txt").reshape(-1, 3, 4)
    first, second = (np.vstack([rows[i], [0, 0, 0, 1]]) for i in (94, 95))
    T = se3.inverse(KITTI_CALIBRATION) @ se3.inverse(first) @ second @ KITTI_CALIBRATION
    found = {}
    for name, files in _sequences(folder).items():
        node: LidarSlam = Registry.default().make_dfpc("lidar_slam")  # type: ignore[assignment]
        node.configure(None)
        poses = []
        for i, path in enumerate(files):
            points = read_kitti_bin(path).points_m.astype(np.float32)
            at = i * 100_000_000
            scan = LidarScan.from_arrays(
                points, np.zeros(len(points), np.uint32), frame="robot/lidar", t0_ns=at, t1_ns=at
            )
            poses += [o for o in node.step(Sample("scan", at, i, scan)) if o.port == "odometry"]
        last = poses[-1]
        found[name] = {
            "status": str(last.quality.status), "reasons": list(last.quality.reasons),
            "inlier_ratio": round(last.quality.metrics["inlier_ratio"], 3),
        }  # fmt: skip
        if last.value is not None:
            found[name]["moved_m"] = round(float(np.linalg.norm(last.value.transform.matrix[:3, 3])), 3)
        if name == "94, 95" and last.value is not None:
            E = se3.inverse(T) @ last.value.transform.matrix
            found[name]["error_m"] = round(float(np.linalg.norm(E[:3, 3])), 4)
            found[name]["error_deg"] = round(float(np.degrees(se3.rotation_angle(E[:3, :3]))), 4)
    return found


def _sequences(folder: Path) -> dict[str, list[Path]]:
    files = sorted(folder.glob("*.bin"))
    pair = [f for f in files if f.stem in ("000094", "000095")]
    rest = [f for f in files if f not in pair]
    return {"94, 95": pair} | ({", ".join(str(int(f.stem)) for f in rest): rest} if rest else {})
