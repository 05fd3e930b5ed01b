# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar SLAM against truth: simulated traverses beside kiss-icp, loops, plains, laps; real sweeps as they are.

Simulated: ``deploy/simulation/lidar_traverse.yaml`` and ``lidar_plain.yaml``. Seeds 1 and 2 were used while the DFPC
was made, its covariance included, and are not used here. kiss-icp gets the same sweeps where CDFF_PEER_PYTHON names an
environment that has it, with its own parameters for the range; it deskews by the motion between sweeps, so it is given
that motion in the share of a sweep that a revolution takes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta, chi2

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from cdff_core.dfpcs.lidar_slam.closing import LoopCloser
from cdff_core.dfpcs.lidar_slam.compound import LidarSlam
from cdff_core.runtime import Runner
from cdff_dev.evaluate._lidar_slam_page import draw, table
from cdff_dev.evaluate._peers import SweepFile, peer_python
from cdff_dev.evaluate.record import spread
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.traverse import simulate
from cdff_dev.trajectory.compare import Comparison, compare
from cdff_dev.trajectory.track import Track

__all__ = ["draw", "evaluate", "table"]

ROBOT = "mana"
SEEDS = (20260901, 20260911)
PLAIN_SEEDS = (20260902, 20260912)
#: Short drives, one squared error by covariance of each.
SHORT_SEEDS, SHORT_S = range(3000, 3050), 16.0
#: Their ground: that of the traverse so far as they see it.
SHORT_HALF_WIDTH_M = 70.0
SEGMENTS_M = (10.0, 20.0, 50.0, 100.0, 200.0, 400.0)
PAIRS = 500
#: Places so far apart are not one; a registration of them is right within these of the truth.
APART_M, RIGHT_M, RIGHT_DEG = 20.0, 0.3, 3.0
#: Lidar of the laps: a third of the points.
LAPS = {"columns": 600}
KITTI_CALIBRATION = np.array(
    [
        [4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02],
        [-7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02],
        [9.999738645903e-01, 4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


@dataclass(slots=True)
class Run:
    """What came out of one drive.

    Attributes
    ----------
    node : LidarSlam
    truth : dict of int to ndarray, shape (4, 4)
        ``T_site_lidar`` by stamp.
    wheels : dict of int to ndarray, shape (4, 4)
        ``T_odom_lidar`` by the wheels alone.
    products : dict of str to list of Product
        By port.
    cpu_s, wall_s : list of float
        Of each sweep.
    """

    node: LidarSlam
    truth: dict[int, FloatArray] = field(default_factory=dict)
    wheels: dict[int, FloatArray] = field(default_factory=dict)
    products: dict[str, list[Product]] = field(default_factory=dict)
    cpu_s: list[float] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)

    def track(self, port: str) -> Track:
        """Poses of a port, those that were refused left out."""
        found = [p for p in self.products[port] if p.value is not None]
        poses = [p.value.transform for p in found]
        covariances = np.array([p.covariance for p in poses])
        return Track(port, np.array([p.header.t1_ns for p in found]), np.array([p.matrix for p in poses]), covariances)

    def trajectory(self) -> Track:
        """The trajectory as known at the end."""
        value = self.products["trajectory"][-1].value
        return Track("trajectory", value.stamps_ns, value.matrices, value.covariances)

    def reference(self, track: Track) -> Track:
        """The truth at the stamps of a track."""
        return Track("truth", track.stamps_ns, np.array([self.truth[int(t)] for t in track.stamps_ns]))


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """All figures."""
    figures: dict[str, Any] = {"simulated": {}, "real": {"kitti_velodyne": kitti(data / "kitti_velodyne")}}
    python = peer_python()
    for seed in SEEDS:
        with SweepFile() as stored:
            keep = stored if python and seed == SEEDS[0] else None
            run = drive(load_scenario("lidar_traverse", seed), progress, keep=keep)
            figures["simulated"][f"lidar_traverse, seed {seed}"] = traverse(run)
            if keep is not None and python:
                progress(f"lidar slam: kiss-icp, {len(run.cpu_s)} sweeps")
                figures["simulated"][f"kiss-icp 1.3.0, seed {seed}"] = kiss_icp(python, keep, run)
        if seed == SEEDS[0]:
            figures["simulated"]["loops"] = loops(run, progress)
    figures["simulated"]["short drives"] = consistency(progress)
    figures["simulated"]["lidar_plain"] = plains(progress)
    figures["simulated"]["laps"] = laps(progress)
    return figures


def slam(scenario: Scenario) -> LidarSlam:
    """The DFPC with its defaults and the lidar's mount."""
    frames = FrameGraph()
    mount = UncertainTransform(scenario.lidar.mount.matrix(), np.zeros((6, 6)))
    frames.set_static(f"{ROBOT}/base", f"{ROBOT}/lidar", mount)
    node: LidarSlam = Registry.default().make_dfpc("lidar_slam")  # type: ignore[assignment]
    node.configure(None, DfpcContext(ROBOT, frames))
    return node


def drive(
    scenario: Scenario, progress: Callable[[str], None], *, wheels: bool = False, keep: SweepFile | None = None
) -> Run:
    """Run the DFPC over a scenario as it is simulated; nothing is stored but the sweeps for a peer."""
    run = Run(slam(scenario))
    runner = Runner(run.node)
    ports = {f"/{ROBOT}/lidar.scan": "scan"} | ({f"/{ROBOT}/wheels.odometry": "odometry"} if wheels else {})
    for entry, value in simulate(scenario, workers=int(scenario.duration_s > SHORT_S)):
        if entry.stream == f"/{ROBOT}/wheels.odometry":
            run.wheels[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream == f"/{ROBOT}/truth.pose":
            run.truth[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream not in ports:
            continue
        if ports[entry.stream] == "scan":
            progress(f"lidar slam: {scenario.name}, seed {scenario.seed}, sweep {len(run.cpu_s)}")
            if keep is not None:
                keep.append(value)
        runner.push(Sample(ports[entry.stream], entry.stamp_ns, entry.header.seq, value))
        began_s, began_wall_s = time.process_time(), time.perf_counter()
        _sort(run, runner.drain())
        if ports[entry.stream] == "scan":
            run.cpu_s.append(time.process_time() - began_s)
            run.wall_s.append(time.perf_counter() - began_wall_s)
    _sort(run, runner.finish())
    return run


def _sort(run: Run, products: Any) -> None:
    for product in products:
        run.products.setdefault(product.port, []).append(product)


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
        "cpu_s_per_sweep": _times(run.cpu_s),
        "wall_s_per_sweep": _times(run.wall_s),
    }


def errors(track: Track, run: Run) -> dict[str, Any]:
    """Drift over segments, absolute error and normalised squared error."""
    found = compare(track, run.reference(track), segments_m=SEGMENTS_M)
    figures = found.figures
    drift = figures["drift"]
    rmse_m = figures["ate"]["translation_m"]["rmse"]
    return {
        "drift_percent": {int(s["length_m"]): round(s["translation_percent"], 4) for s in drift["segments"]},
        "drift_deg_per_m": {int(s["length_m"]): round(s["rotation_deg_per_m"], 6) for s in drift["segments"]},
        "ate_rmse_m": round(rmse_m, 4),
        "ate_percent_of_way": round(figures["ate"]["rmse_percent_of_way"], 5),
        "nees": _nees(track, run.reference(track)),
        "along": _along(found),
    }


def _along(found: Comparison) -> dict[str, list[float]]:
    """A hundred poses of the way: its length, where the lidar was and was thought to be, the distance between both."""
    rows = np.unique(np.linspace(0, len(found.reference) - 1, 100).astype(int))
    xy, estimate = found.reference.positions_m[rows, :2], found.estimate.positions_m[rows, :2]
    columns = {
        "way_m": found.reference.distances_m[rows], "error_m": found.position_errors_m[rows],
        "x_m": xy[:, 0], "y_m": xy[:, 1], "estimated_x_m": estimate[:, 0], "estimated_y_m": estimate[:, 1],
    }  # fmt: skip
    return {name: [round(float(v), 3) for v in column] for name, column in columns.items()}


def _nees(track: Track, reference: Track) -> dict[str, float]:
    """Squared error by the stated covariance, both tracks begun at the same pose; 6 are expected."""
    if track.covariances is None:
        return {"count": 0}
    T_first = track.matrices[0] @ se3.inverse(reference.matrices[0])
    values = []
    for T, T_true, C in zip(track.matrices[20::20], reference.matrices[20::20], track.covariances[20::20], strict=True):
        e = pose_error(T_first @ T_true, T)
        values.append(float(e @ np.linalg.solve(C + 1e-12 * np.eye(6), e)))
    return spread(values) | {"mean": round(float(np.mean(values)), 3)}


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
            "pairs_within_5_m": len(same), "named": hits, "recall_95": bound(hits, len(same)),
            "named_in_all": len(named), "of_these_within_10_m": close, "precision_95": bound(close, max(len(named), 1)),
        },
        "verification": {
            what: {"trials": sum(v), "right": v[0], "wrong": v[1], "refused": v[2], "wrong_95": bound(v[1], sum(v))}
            for what, v in verdicts.items()
        },
    }  # fmt: skip


def kiss_icp(python: str, stored: SweepFile, run: Run) -> dict[str, Any]:
    """The peer on the same sweeps, on one thread."""
    config = run.node.config
    poses, cpu_s, wall_s = stored.kiss_icp(python, (config.min_range_m, config.max_range_m))
    track = Track("kiss-icp", run.track("odometry").stamps_ns, poses)
    return errors(track, run) | {"cpu_s_per_sweep": _times(cpu_s), "wall_s_per_sweep": _times(wall_s)}


def _times(seconds: Sequence[float]) -> dict[str, float]:
    """Of a sweep, the two at which code is compiled left out."""
    return spread(seconds[2:]) | {"mean": round(float(np.mean(seconds[2:])), 4)}


def consistency(progress: Callable[[str], None]) -> dict[str, Any]:
    """Squared error by covariance of the last pose of short drives from rest, each on ground of its own."""
    values, shifts_m, turns_deg = [], [], []
    for seed in SHORT_SEEDS:
        run = drive(_short(seed), progress)
        track = run.track("odometry")
        T_true = se3.inverse(run.truth[int(track.stamps_ns[0])]) @ run.truth[int(track.stamps_ns[-1])]
        C, e = track.covariances[-1], pose_error(T_true, track.matrices[-1])
        values.append(float(e @ np.linalg.solve(C, e)))
        shifts_m.append(float(np.sqrt(np.trace(C[:3, :3]) / 3.0)))
        turns_deg.append(float(np.degrees(np.sqrt(np.trace(C[3:, 3:]) / 3.0))))
    n = len(values)
    return {
        "drives": n, "seconds": SHORT_S, "mean_nees": round(float(np.mean(values)), 3), "nees": spread(values),
        "band_95": [round(float(chi2.ppf(q, 6 * n)) / n, 3) for q in (0.025, 0.975)],
        "mean_sigma_m": round(float(np.mean(shifts_m)), 5), "mean_sigma_deg": round(float(np.mean(turns_deg)), 5),
    }  # fmt: skip


def _short(seed: int) -> Scenario:
    """The begin of a traverse, on a piece of such ground with as many craters and rocks a square metre."""
    base = load_scenario("lidar_traverse", seed)
    ground: dict[str, Any] = {"fine_half_width_m": SHORT_HALF_WIDTH_M}
    for of in ("craters", "rocks"):
        part = getattr(base.terrain, of)
        count = round(part.count * (SHORT_HALF_WIDTH_M / part.half_width_m) ** 2)
        ground[of] = part.model_copy(update={"count": count, "half_width_m": SHORT_HALF_WIDTH_M})
    return base.model_copy(update={"duration_s": SHORT_S, "terrain": base.terrain.model_copy(update=ground)})


def plains(progress: Callable[[str], None]) -> dict[str, Any]:
    """Flags on a plain without relief, where nothing else is in range, and off it; drift over it."""
    flagged = {"on": [0, 0], "off": [0, 0]}
    rows: dict[str, Any] = {}
    for seed in PLAIN_SEEDS:
        run = drive(load_scenario("lidar_plain", seed), progress, wheels=True)
        for product in run.products["pose"][6:]:
            x = abs(float(run.truth[product.header.t1_ns][0, 3]))
            degenerate = any(r.startswith("degenerate:") for r in product.header.quality.reasons)
            where = "on" if x < 35.0 else "off" if x > 105.0 else None
            if where is not None:
                flagged[where][0] += degenerate
                flagged[where][1] += 1
        odometry = run.track("odometry")
        rows[f"seed {seed}, with wheel odometry"] = errors(odometry, run)
        stamps = [t for t in odometry.stamps_ns.tolist() if t in run.wheels]
        rows[f"seed {seed}, wheels alone"] = errors(
            Track("wheels", np.array(stamps), np.array([run.wheels[t] for t in stamps])), run
        )
    return {
        "sweeps_on_the_plain_flagged": _rate(flagged["on"]), "sweeps_off_it_flagged": _rate(flagged["off"]), **rows
    }  # fmt: skip


def _rate(counted: list[int]) -> dict[str, Any]:
    return {"flagged": counted[0], "trials": counted[1], "interval_95": bound(*counted)}


def laps(progress: Callable[[str], None]) -> dict[str, Any]:
    """Key frames and memory over laps of one loop: the scenario driven on, with half of the points."""
    base = load_scenario("lidar_traverse", SEEDS[0])
    scenario = base.model_copy(update={"duration_s": 1020.0, "lidar": base.lidar.model_copy(update=LAPS)})
    run = drive(scenario, progress)
    rows = {}
    for product in run.products["graph"]:
        m = product.header.quality.metrics
        rows[int(m["way_m"] // 50) * 50] = {"keyframes": int(m["keyframes"]), "cloud_mb": round(m["cloud_mb"], 1)}
    return {"by_way_m": rows, "trajectory at the end": errors(run.trajectory(), run)}


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


def bound(count: int, trials: int) -> list[float]:
    """Two-sided 95 % interval of a rate."""
    low = 0.0 if count == 0 else float(beta.ppf(0.025, count, trials - count + 1))
    high = 1.0 if count == trials else float(beta.ppf(0.975, count + 1, trials - count))
    return [round(low, 5), round(high, 5)]
