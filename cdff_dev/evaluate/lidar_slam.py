# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar SLAM against truth: simulated traverses beside kiss-icp, loops, plains, laps; real sweeps as they are.

Simulated: ``deploy/simulation/lidar_traverse.yaml`` and ``lidar_plain.yaml``. Seeds 1 and 2 were used while the DFPC
was made and are not used here. kiss-icp gets the same sweeps with its own parameters for the range; it deskews by the
motion between sweeps, so it is given that motion in the share of a sweep that a revolution takes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from cdff_core.dfpcs.lidar_slam.closing import LoopCloser
from cdff_core.dfpcs.lidar_slam.compound import LidarSlam
from cdff_core.runtime import Runner
from cdff_dev.evaluate.record import spread
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.traverse import simulate
from cdff_dev.trajectory.compare import Comparison, compare
from cdff_dev.trajectory.plot import panel
from cdff_dev.trajectory.track import Track

ROBOT = "mana"
SEEDS = (20260901, 20260911)
PLAIN_SEEDS = (20260902, 20260912, 20260922)
SEGMENTS_M = (10.0, 20.0, 50.0, 100.0, 200.0, 400.0)
PAIRS = 500
#: Places so far apart are not one; a registration of them is right within these of the truth.
APART_M, RIGHT_M, RIGHT_DEG = 20.0, 0.3, 3.0
#: Lidar of the laps: half of the points.
LAPS = {"columns": 900}
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
    products : dict of str to list of Product
        By port.
    cpu_s : list of float
        Of each sweep.
    """

    node: LidarSlam
    truth: dict[int, FloatArray] = field(default_factory=dict)
    products: dict[str, list[Product]] = field(default_factory=dict)
    cpu_s: list[float] = field(default_factory=list)

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
    for seed in SEEDS:
        run, scans = drive(load_scenario("lidar_traverse", seed), progress, keep_scans=seed == SEEDS[0])
        figures["simulated"][f"lidar_traverse, seed {seed}"] = traverse(run)
        if seed == SEEDS[0]:
            figures["simulated"]["loops"] = loops(run, progress)
            figures["simulated"][f"kiss-icp 1.3.0, seed {seed}"] = kiss_icp(scans, run, progress)
    figures["simulated"]["lidar_plain"] = plains(progress)
    figures["simulated"]["laps"] = laps(progress)
    figures["simulated"]["lidar_traverse with 32 x 450"] = sparse(progress)
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
    scenario: Scenario, progress: Callable[[str], None], *, wheels: bool = False, keep_scans: bool = False
) -> tuple[Run, list[LidarScan]]:
    """Run the DFPC over a scenario as it is simulated; nothing is stored."""
    run, scans = Run(slam(scenario)), []
    runner = Runner(run.node)
    ports = {f"/{ROBOT}/lidar.scan": "scan"} | ({f"/{ROBOT}/wheels.odometry": "odometry"} if wheels else {})
    for entry, value in simulate(scenario, workers=0):
        if entry.stream == f"/{ROBOT}/truth.pose":
            run.truth[entry.stamp_ns] = value.transform.matrix @ scenario.lidar.mount.matrix()
        if entry.stream not in ports:
            continue
        if ports[entry.stream] == "scan":
            progress(f"lidar slam: {scenario.name}, seed {scenario.seed}, sweep {len(run.cpu_s)}")
            if keep_scans:
                scans.append(value)
        runner.push(Sample(ports[entry.stream], entry.stamp_ns, entry.header.seq, value))
        began_s = time.process_time()
        _sort(run, runner.drain())
        if ports[entry.stream] == "scan":
            run.cpu_s.append(time.process_time() - began_s)
    _sort(run, runner.finish())
    return run, scans


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
        "cpu_s_per_sweep": spread(run.cpu_s[2:]) | {"mean": round(float(np.mean(run.cpu_s[2:])), 4)},
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


def draw(figures: dict[str, Any]) -> bytes:
    """SVG: the first traverse from above, true and estimated, and the errors along it beside kiss-icp's."""
    rows = figures["simulated"]
    ours = rows[f"lidar_traverse, seed {SEEDS[0]}"]
    final = ours["trajectory at the end"]["along"]
    curves = {"#c0392b": final, "#2c7fb8": ours["odometry"]["along"]}
    peer = rows.get(f"kiss-icp 1.3.0, seed {SEEDS[0]}", {})
    if "along" in peer:
        curves["#777777"] = peer["along"]
    plan = [np.column_stack([final[f"{of}x_m"], final[f"{of}y_m"]]) for of in ("", "estimated_")]
    errors_m = [np.column_stack([c["way_m"], c["error_m"]]) for c in curves.values()]
    above = panel(0.0, plan, ("#777777", "#c0392b"), ("x m", "y m"), equal=True)
    along = panel(520.0, errors_m, tuple(curves), ("way m", "error m"), equal=False)
    names = ("trajectory at the end", "odometry", "kiss-icp")[: len(curves)]
    legend = "".join(
        f'<text x="{572 + 150 * i}" y="18" fill="{colour}">{name}</text>'
        for i, (name, colour) in enumerate(zip(names, curves, strict=True))
    )
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1040 360" font-family="sans-serif" font-size="12">'
        f'<rect width="100%" height="100%" fill="white"/>{legend}{above}{along}</svg>\n'
    ).encode()


def _nees(track: Track, reference: Track) -> dict[str, float]:
    """Squared error by the stated covariance, both tracks begun at the same pose; 6 are expected."""
    from cdff_common.geometry.covariance import pose_error

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


def kiss_icp(scans: list[LidarScan], run: Run, progress: Callable[[str], None]) -> dict[str, Any]:
    """The peer on the same sweeps; left out where it is not installed."""
    try:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP
    except ImportError:
        return {"left_out": "kiss-icp is not installed (extra test)"}
    config = KISSConfig()
    config.data.max_range, config.data.min_range = run.node.config.max_range_m, run.node.config.min_range_m
    config.mapping.voxel_size = config.data.max_range / 100.0
    config.registration.max_num_threads = 1
    peer = KissICP(config)
    preprocess, poses, cpu_s = peer.preprocessor.preprocess, [], []
    share = (scans[0].t1_ns - scans[0].t0_ns) / (scans[1].t1_ns - scans[0].t1_ns)
    for n, scan in enumerate(scans):
        progress(f"lidar slam: kiss-icp, sweep {n}")
        began_s = time.process_time()
        motion = se3.exp_se3(share * se3.log_se3(peer.last_delta))
        peer.preprocessor.preprocess = lambda frame, stamps, _, motion=motion: preprocess(frame, stamps, motion)
        length_us = (scan.t1_ns - scan.t0_ns) / 1000.0
        peer.register_frame(np.asarray(scan.points_m, np.float64), np.asarray(scan.time_offset_us) / length_us)
        cpu_s.append(time.process_time() - began_s)
        poses.append(peer.last_pose.copy())
    track = Track("kiss-icp", np.array([s.t1_ns for s in scans]), np.array(poses))
    return {**errors(track, run), "cpu_s_per_sweep": spread(cpu_s)}


def plains(progress: Callable[[str], None]) -> dict[str, Any]:
    """Flags on a plain without relief, where nothing else is in range, and off it; drift over it."""
    flagged = {"on": [0, 0], "off": [0, 0]}
    rows: dict[str, Any] = {}
    for seed in PLAIN_SEEDS:
        run, _ = drive(load_scenario("lidar_plain", seed), progress, wheels=True)
        for product in run.products["pose"][6:]:
            x = abs(float(run.truth[product.header.t1_ns][0, 3]))
            degenerate = any(r.startswith("degenerate:") for r in product.header.quality.reasons)
            where = "on" if x < 35.0 else "off" if x > 105.0 else None
            if where is not None:
                flagged[where][0] += degenerate
                flagged[where][1] += 1
        rows[f"seed {seed}, with wheel odometry"] = errors(run.track("odometry"), run)
    return {
        "sweeps_on_the_plain_flagged": _rate(flagged["on"]), "sweeps_off_it_flagged": _rate(flagged["off"]), **rows
    }  # fmt: skip


def _rate(counted: list[int]) -> dict[str, Any]:
    return {"flagged": counted[0], "trials": counted[1], "interval_95": bound(*counted)}


def laps(progress: Callable[[str], None]) -> dict[str, Any]:
    """Key frames and memory over laps of one loop: the scenario driven on, with half of the points."""
    base = load_scenario("lidar_traverse", SEEDS[0])
    scenario = base.model_copy(update={"duration_s": 1020.0, "lidar": base.lidar.model_copy(update=LAPS)})
    run, _ = drive(scenario, progress)
    rows = {}
    for product in run.products["graph"]:
        m = product.header.quality.metrics
        rows[int(m["way_m"] // 50) * 50] = {"keyframes": int(m["keyframes"]), "cloud_mb": round(m["cloud_mb"], 1)}
    return {"by_way_m": rows, "trajectory at the end": errors(run.trajectory(), run)}


def sparse(progress: Callable[[str], None]) -> dict[str, Any]:
    """A lidar with an eighth of the points, with the defaults made for 64 x 1800: where they end."""
    base = load_scenario("lidar_traverse", SEEDS[0])
    scenario = base.model_copy(update={"lidar": base.lidar.model_copy(update={"rings": 32, "columns": 450})})
    run, _ = drive(scenario, progress)
    return traverse(run)


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
