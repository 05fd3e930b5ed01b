# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate lidar localisation on a map of ``lidar_slam`` and on maps assembled by a DPM.

All maps show the first 60 m of the drive of ``lidar_localisation``. ``lidar_slam`` maps them with two sweeps
per second and exports its map in the frame of its first sweep, which is tilted like the lidar. The DPM stores
the clouds of 40 sweeps, with the pose errors of a survey, and elevation patches of these clouds. The robot
then drives half a metre next to this path and is localised on all maps. Its odometry drifts by 1 % and
0.07 degrees per metre; its first sweep is localised without a guess.

On the map of lidar_slam errors are relative to the nearest keyframe; the error in the site frame is stated
separately.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cdff_common.clock import NS_PER_S
from cdff_common.codecs import encode
from cdff_common.codecs.wire_types import wire_type
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.product import Header, Status, product_id
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap, LidarMap, LidarScan, Pointcloud, TransformWithCovariance
from cdff_dev.compare.diagrams import svg_text
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import interval, pose_errors, rate_text
from cdff_dev.simulate.rover_motion import settle
from cdff_dev.simulate.scenario import load_scenario
from dpm_store import NewProduct, Query, open_store
from dpm_store.maps.windows import WindowQuery
from evaluation.lidar_localisation import (
    LIMIT_DEG,
    LIMIT_M,
    MAP_TIMES_S,
    SCENARIO,
    WRONG_M,
    SimulatedGround,
    simulated_ground,
)
from evaluation.lidar_slam import drive

#: Page that contains the table of this evaluation.
PAGE = "lidar_localisation"

#: Number of sweeps, and distance of the drive from the mapped path.
SWEEPS, ASIDE_M = 200, 0.5
CELL_M, CLOUD_VOXEL_M, MAX_POINTS = 0.1, 0.15, 1_000_000
#: Odometry drift per metre: twist (6,), metres and radians.
_DRIFT_PER_M = np.array([0.01, 0.0, 0.0, 0.0, 0.0, np.radians(0.07)])


@dataclass(slots=True)
class MapRun:
    """The localisation of all sweeps on one map.

    Attributes
    ----------
    sample : Sample
        Sample with the map.
    anchors : list of (ndarray, ndarray)
        Poses ``(4, 4)`` of the same frame in the map frame and in the site frame.
    """

    sample: Sample
    anchors: list[tuple[FloatArray, FloatArray]]
    dfpc: Dfpc = field(init=False)
    errors: list[tuple[float, float]] = field(default_factory=list)
    from_site_m: list[float] = field(default_factory=list)
    answered: list[int] = field(default_factory=list)
    refused: int = 0

    def __post_init__(self) -> None:
        self.dfpc = Registry.default().make_dfpc("lidar_localisation")
        self.dfpc.configure({})
        list(self.dfpc.step(self.sample))

    def true_pose(self, T_site_lidar: FloatArray) -> FloatArray:
        """Return the true ``T_map_lidar``, computed from the nearest anchor."""
        in_map, in_site = min(
            self.anchors, key=lambda a: float(np.linalg.norm(a[1][:3, 3] - T_site_lidar[:3, 3]))
        )
        return in_map @ se3.inverse(in_site) @ T_site_lidar

    def localise(self, scan: Sample, odometry: Sample, T_site_lidar: FloatArray) -> None:
        """Localise one sweep and record the error."""
        list(self.dfpc.step(odometry))
        (output,) = self.dfpc.step(scan)
        if output.quality.status is Status.FAILED:
            self.refused += 1
            return
        T, (in_map, in_site) = output.value.transform.matrix, self.anchors[0]
        self.answered.append(scan.seq)
        self.errors.append(pose_errors(T, self.true_pose(T_site_lidar)))
        self.from_site_m.append(pose_errors(T, in_map @ se3.inverse(in_site) @ T_site_lidar)[0])

    def summary(self) -> dict[str, Any]:
        """Return the numbers of accurate, wrong and refused answers, and the errors."""
        trials = len(self.errors) + self.refused
        accurate = sum(m <= LIMIT_M and d <= LIMIT_DEG for m, d in self.errors)
        return {
            "sweeps": trials,
            "within_3_cm_and_0.1_deg": interval(accurate, trials),
            "refused": self.refused,
            "wrong": interval(sum(m > WRONG_M for m, _ in self.errors), trials),
            "error_m": error_summary([m for m, _ in self.errors], 5),
            "error_deg": error_summary([d for _, d in self.errors], 5),
            "from_site_m": error_summary(self.from_site_m, 5),
            "along": {
                "sweep": self.answered[::2],
                "error_m": [round(m, 5) for m, _ in self.errors[::2]],
                "error_deg": [round(d, 4) for _, d in self.errors[::2]],
            },
        }


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results of the drive on each map."""
    ground = simulated_ground()
    maps = make_map_runs(ground, progress)
    rng = np.random.default_rng(4)
    mount = ground.scenario.lidar.mount.matrix()
    times_s = np.linspace(MAP_TIMES_S[0], MAP_TIMES_S[-1], SWEEPS)
    T_odom_lidar, T_previous, positions = np.eye(4), None, []
    for i, t_s in enumerate(times_s):
        progress(f"lidar localisation: sweep {i} of {SWEEPS} on {len(maps)} maps")
        T = ground.on_path(t_s)
        xy = T[:2, 3] + ASIDE_M * T[:2, 1]
        T = settle(
            ground.relief, ground.scenario.chassis, xy[None], np.array([np.arctan2(T[1, 0], T[0, 0])])
        )[0]
        points, T = ground.sweep(T, rng), T @ mount
        if T_previous is not None:
            step = se3.inverse(T_previous) @ T
            T_odom_lidar = T_odom_lidar @ step @ se3.exp_se3(_DRIFT_PER_M * np.linalg.norm(step[:3, 3]))
        positions.append(T[:3, 3])
        T_previous, stamp_ns = T, round((t_s - times_s[0]) * 1e6) * 1000
        odometry = TransformWithCovariance.from_transform(
            UncertainTransform(T_odom_lidar), parent="odom", child="lidar", stamp_ns=stamp_ns
        )
        for map_run in maps.values():
            map_run.localise(
                Sample("scan", stamp_ns, i, at_rest(points, stamp_ns)),
                Sample("odometry", stamp_ns, i, odometry),
                T,
            )
    path_length_m = float(np.sum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    return {
        "path_length_m": round(path_length_m, 1),
        "drives": {name: map_run.summary() for name, map_run in maps.items()},
    }


def make_map_runs(ground: SimulatedGround, progress: Callable[[str], None]) -> dict[str, MapRun]:
    """Return a run for each map, by name."""
    slam, anchors = slam_map(progress)
    clouds, patches = dpm_maps(ground)
    same_frame = [(np.eye(4), np.eye(4))]
    return {
        "lidar_slam": MapRun(Sample("graph_map", 0, 0, slam), anchors),
        "clouds of a DPM": MapRun(Sample("map", 0, 0, clouds), same_frame),
        "elevation of a DPM": MapRun(Sample("dem", 0, 0, patches), same_frame),
    }


def slam_map(progress: Callable[[str], None]) -> tuple[LidarMap, list[tuple[FloatArray, FloatArray]]]:
    """Return the exported map of lidar_slam, and estimated and true poses of its keyframes in time order."""
    scenario = load_scenario(SCENARIO).model_copy(update={"duration_s": float(MAP_TIMES_S[-1]) + 2.0})
    run = drive(scenario, progress)
    result: LidarMap = run.node.call("export_map", {})
    frames = result.graph.vertices
    poses = zip(frames.stamps_ns.tolist(), frames.matrices, strict=True)
    return result, [(T, run.truth[stamp_ns]) for stamp_ns, T in sorted(poses, key=lambda pose: pose[0])]


def dpm_maps(ground: SimulatedGround) -> tuple[Pointcloud, ElevationMap]:
    """Return the cloud and the elevation window that a DPM assembles from the clouds and patches of the
    survey.
    """
    products = []
    for i, points in enumerate(ground.pieces(0)):
        stamp_ns = (i + 1) * NS_PER_S
        cloud = Pointcloud.from_points(voxel_means(points, CLOUD_VOXEL_M), frame="site", stamp_ns=stamp_ns)
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        geometry = GridGeometry.aligned("site", CELL_M, (*low, *high))
        layers = CellStatistics.from_points(geometry, points, stamps_ns=stamp_ns).to_layers(stamp_ns)
        patch = ElevationMap.from_layers(geometry, layers, t0_ns=stamp_ns, t1_ns=stamp_ns)
        products += [_product(cloud, "pointcloud", i, stamp_ns), _product(patch, "dem", i, stamp_ns)]
    with tempfile.TemporaryDirectory() as folder, open_store(f"sqlite:///{folder}") as store:
        store.put_all(products)
        cloud: Pointcloud = store.clouds.assemble(Query(frame="site"), MAX_POINTS).cloud
        return cloud, store.maps.elevation_window(WindowQuery(resolution_m=CELL_M)).map


def _product(value: Any, product: str, seq: int, stamp_ns: int) -> NewProduct:
    header = Header(
        id=product_id("mana", "survey", product, stamp_ns, seq, ""),
        seq=seq,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns,
        frame="site",
        producer="survey",
        config_hash="",
        box_m=value.extent_m(),
    )
    return NewProduct(
        header, encode(value, "uper"), "mana", "survey", product, product, wire_type(value), "uper", value
    )


def at_rest(points_m: FloatArray, stamp_ns: int) -> LidarScan:
    """Return a sweep whose points all have the same time."""
    point_times = np.zeros(len(points_m), np.uint32)
    return LidarScan.from_arrays(
        points_m.astype(np.float32), point_times, frame="lidar", t0_ns=stamp_ns, t1_ns=stamp_ns
    )


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram of the errors along the path on each map, as SVG."""
    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for name, row in figures["drives"].items():
        path_length_m = figures["path_length_m"] * np.array(row["along"]["sweep"]) / (row["sweeps"] - 1)
        axes[0].plot(path_length_m, 1e3 * np.array(row["along"]["error_m"]), lw=1.0, label=name)
        axes[1].plot(path_length_m, row["along"]["error_deg"], lw=1.0)
    for axis, limit, label in zip(
        axes, (1e3 * LIMIT_M, LIMIT_DEG), ("error, mm", "error, degrees"), strict=True
    ):
        axis.axhline(limit, color="black", lw=0.6, ls="--")
        axis.set(ylabel=label, ylim=(0.0, None))
    axes[0].legend(fontsize=8)
    axes[1].set(xlabel="path length, m; the first sweep is searched for on the whole map")
    return svg_text(figure).encode()


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each map."""
    lines = [
        "| map, first sweep without a guess | within 3 cm and 0.1° | median error | maximum | refused | "
        "wrong | median error in the site frame |",
        "|---" * 7 + "|",
    ]
    for name, row in figures["drives"].items():
        translation, rotation = row["error_m"], row["error_deg"]
        answered = translation["count"] > 0
        cells = [
            f"{1e3 * translation['median']:.1f} mm, {rotation['median']:.3f}°" if answered else "–",
            f"{1e3 * translation['max']:.1f} mm, {rotation['max']:.3f}°" if answered else "–",
            f"{row['refused']}",
            rate_text(row["wrong"]),
            f"{1e3 * row['from_site_m']['median']:.1f} mm" if answered else "–",
        ]
        lines.append(f"| {name} | {rate_text(row['within_3_cm_and_0.1_deg'])} | {' | '.join(cells)} |")
    return "\n".join(lines)
