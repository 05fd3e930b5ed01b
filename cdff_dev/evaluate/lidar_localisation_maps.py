# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar localisation on maps that others made: by ``lidar_slam``, and what a DPM assembles.

All are of the first 60 m of the ground of ``lidar_localisation``. ``lidar_slam`` drives there, two sweeps a second, and
exports its map, whose frame is that of its first sweep and as tilted as the lidar. The DPM has the clouds of 40 sweeps,
each put down with the errors of a survey, and elevation patches of the same. Then the robot drives on all of them at
once half a metre beside that way, with odometry that drifts by 1 % and 0.07 degrees a metre; its first sweep is
searched for without a guess.

Errors are against where the map has the robot's surroundings: on the map of lidar_slam the truth is laid from the
nearest key frame. How far that map as a whole is from the site's truth is given beside it.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.codecs import encode
from cdff_common.codecs.siblings import wire_type
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_common.interfaces.product import Header, Status, product_id
from cdff_common.interfaces.registry import Registry
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.types import ElevationMap, LidarMap, LidarScan, Pointcloud, TransformWithCovariance
from cdff_dev.evaluate.lidar_localisation import LIMIT_DEG, LIMIT_M, MAP_TIMES_S, SCENARIO, WRONG_M, Place, place
from cdff_dev.evaluate.lidar_slam import drive
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import in_words, interval, pose_errors
from cdff_dev.simulate.drive import settle
from cdff_dev.simulate.scenario import load_scenario
from dpm_store import Parcel, Query, open_store
from dpm_store.windows import WindowQuery

#: Its page and what else is there are those of this evaluation.
PAGE = "lidar_localisation"

SWEEPS, ASIDE_M = 200, 0.5
CELL_M, CLOUD_VOXEL_M, MOST_POINTS = 0.1, 0.15, 1_000_000
_DRIFT_PER_M = np.array([0.01, 0.0, 0.0, 0.0, 0.0, np.radians(0.07)])


@dataclass(slots=True)
class Mapped:
    """A map, the robot on it, and what came of its sweeps.

    Attributes
    ----------
    sample : Sample
        That brings the map.
    anchors : list of (ndarray, ndarray)
        Poses ``(4, 4)`` in the map's frame and in the site's that are the same place.
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

    def truth(self, T_site_lidar: FloatArray) -> FloatArray:
        """``T_map_lidar`` as the nearest anchor has it."""
        in_map, in_site = min(self.anchors, key=lambda a: float(np.linalg.norm(a[1][:3, 3] - T_site_lidar[:3, 3])))
        return in_map @ se3.inverse(in_site) @ T_site_lidar

    def localise(self, scan: Sample, odometry: Sample, T_site_lidar: FloatArray) -> None:
        """Give it a sweep and note the error of its answer."""
        list(self.dfpc.step(odometry))
        (output,) = self.dfpc.step(scan)
        if output.quality.status is Status.FAILED:
            self.refused += 1
            return
        T, (in_map, in_site) = output.value.transform.matrix, self.anchors[0]
        self.answered.append(scan.seq)
        self.errors.append(pose_errors(T, self.truth(T_site_lidar)))
        self.from_site_m.append(pose_errors(T, in_map @ se3.inverse(in_site) @ T_site_lidar)[0])

    def figures(self) -> dict[str, Any]:
        """Right, wrong and refused answers, and the errors."""
        trials = len(self.errors) + self.refused
        good = sum(m <= LIMIT_M and d <= LIMIT_DEG for m, d in self.errors)
        return {
            "sweeps": trials, "within_3_cm_and_0.1_deg": interval(good, trials), "refused": self.refused,
            "wrong": interval(sum(m > WRONG_M for m, _ in self.errors), trials),
            "error_m": spread([m for m, _ in self.errors], 5), "error_deg": spread([d for _, d in self.errors], 5),
            "from_site_m": spread(self.from_site_m, 5),
            "along": {
                "sweep": self.answered[::2], "error_m": [round(m, 5) for m, _ in self.errors[::2]],
                "error_deg": [round(d, 4) for _, d in self.errors[::2]],
            },
        }  # fmt: skip


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """The drive on each map."""
    ground = place()
    maps = maps_of(ground, progress)
    rng = np.random.default_rng(4)
    mount = ground.scenario.lidar.mount.matrix()
    times_s = np.linspace(MAP_TIMES_S[0], MAP_TIMES_S[-1], SWEEPS)
    felt, before, way = np.eye(4), None, []
    for i, t_s in enumerate(times_s):
        progress(f"lidar localisation: sweep {i} of {SWEEPS} on {len(maps)} maps")
        T = ground.on_the_way(t_s)
        xy = T[:2, 3] + ASIDE_M * T[:2, 1]
        T = settle(ground.relief, ground.scenario.chassis, xy[None], np.array([np.arctan2(T[1, 0], T[0, 0])]))[0]
        points, T = ground.sweep(T, rng), T @ mount
        if before is not None:
            step = se3.inverse(before) @ T
            felt = felt @ step @ se3.exp_se3(_DRIFT_PER_M * np.linalg.norm(step[:3, 3]))
        way.append(T[:3, 3])
        before, stamp_ns = T, round((t_s - times_s[0]) * 1e6) * 1000
        odometry = TransformWithCovariance.from_transform(
            UncertainTransform(felt), parent="odom", child="lidar", stamp_ns=stamp_ns
        )
        for mapped in maps.values():
            mapped.localise(
                Sample("scan", stamp_ns, i, at_rest(points, stamp_ns)), Sample("odometry", stamp_ns, i, odometry), T
            )
    way_m = float(np.sum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    return {"way_m": round(way_m, 1), "drives": {name: mapped.figures() for name, mapped in maps.items()}}


def maps_of(ground: Place, progress: Callable[[str], None]) -> dict[str, Mapped]:
    """Each map."""
    slam, anchors = of_slam(progress)
    clouds, patches = from_dpm(ground)
    same = [(np.eye(4), np.eye(4))]
    return {
        "lidar_slam": Mapped(Sample("graph_map", 0, 0, slam), anchors),
        "clouds of a DPM": Mapped(Sample("map", 0, 0, clouds), same),
        "elevation of a DPM": Mapped(Sample("dem", 0, 0, patches), same),
    }


def of_slam(progress: Callable[[str], None]) -> tuple[LidarMap, list[tuple[FloatArray, FloatArray]]]:
    """What lidar_slam exports after its drive, and its key frames' poses in the map and in truth, the first first."""
    scenario = load_scenario(SCENARIO).model_copy(update={"duration_s": float(MAP_TIMES_S[-1]) + 2.0})
    run = drive(scenario, progress)
    made: LidarMap = run.node.call("export_map", {})
    frames = made.graph.vertices
    poses = zip(frames.stamps_ns.tolist(), frames.matrices, strict=True)
    return made, [(T, run.truth[stamp_ns]) for stamp_ns, T in sorted(poses, key=lambda pose: pose[0])]


def from_dpm(ground: Place) -> tuple[Pointcloud, ElevationMap]:
    """The clouds of the survey as a DPM assembles them, and the elevation window that it pools from their patches."""
    parcels = []
    for i, points in enumerate(ground.pieces(0)):
        stamp_ns = (i + 1) * NS_PER_S
        cloud = Pointcloud.from_points(voxel_means(points, CLOUD_VOXEL_M), frame="site", stamp_ns=stamp_ns)
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        geometry = GridGeometry.aligned("site", CELL_M, (*low, *high))
        layers = CellStatistics.from_points(geometry, points, stamps_ns=stamp_ns).to_layers(stamp_ns)
        patch = ElevationMap.from_layers(geometry, layers, t0_ns=stamp_ns, t1_ns=stamp_ns)
        parcels += [_parcel(cloud, "pointcloud", i, stamp_ns), _parcel(patch, "dem", i, stamp_ns)]
    with tempfile.TemporaryDirectory() as folder, open_store(f"sqlite:///{folder}") as store:
        store.put_all(parcels)
        cloud: Pointcloud = store.clouds.assemble(Query(frame="site"), MOST_POINTS).cloud
        return cloud, store.maps.elevation_window(WindowQuery(resolution_m=CELL_M)).map


def _parcel(value: Any, product: str, seq: int, stamp_ns: int) -> Parcel:
    header = Header(
        id=product_id("mana", "survey", product, stamp_ns, seq, ""), seq=seq, t0_ns=stamp_ns, t1_ns=stamp_ns,
        frame="site", producer="survey", config_hash="", box_m=value.extent_m(),
    )  # fmt: skip
    return Parcel(header, encode(value, "uper"), "mana", "survey", product, product, wire_type(value), "uper", value)


def at_rest(points_m: FloatArray, stamp_ns: int) -> LidarScan:
    """A sweep whose points were all taken at once."""
    at_once = np.zeros(len(points_m), np.uint32)
    return LidarScan.from_arrays(points_m.astype(np.float32), at_once, frame="lidar", t0_ns=stamp_ns, t1_ns=stamp_ns)


def draw(figures: dict[str, Any]) -> bytes:
    """Errors along the drive on each map."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "cdff"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 1, figsize=(7, 5), sharex=True)
    for name, row in figures["drives"].items():
        way_m = figures["way_m"] * np.array(row["along"]["sweep"]) / (row["sweeps"] - 1)
        axes[0].plot(way_m, 1e3 * np.array(row["along"]["error_m"]), lw=1.0, label=name)
        axes[1].plot(way_m, row["along"]["error_deg"], lw=1.0)
    for axis, limit, label in zip(axes, (1e3 * LIMIT_M, LIMIT_DEG), ("error, mm", "error, degrees"), strict=True):
        axis.axhline(limit, color="black", lw=0.6, ls="--")
        axis.set(ylabel=label, ylim=(0.0, None))
    axes[0].legend(fontsize=8)
    axes[1].set(xlabel="way, m; the first sweep is searched for on the whole map")
    figure.tight_layout()
    out = io.BytesIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    pyplot.close(figure)
    return out.getvalue()


def table(figures: dict[str, Any]) -> str:
    """The drive on each map."""
    lines = [
        "| map, first sweep without a guess | within 3 cm and 0.1° | median error | greatest | refused | wrong "
        "| median distance from the site's truth |",
        "|---" * 7 + "|",
    ]
    for name, row in figures["drives"].items():
        m, d = row["error_m"], row["error_deg"]
        answered = m["count"] > 0
        cells = [
            f"{1e3 * m['median']:.1f} mm, {d['median']:.3f}°" if answered else "–",
            f"{1e3 * m['max']:.1f} mm, {d['max']:.3f}°" if answered else "–",
            f"{row['refused']}", in_words(row["wrong"]),
            f"{1e3 * row['from_site_m']['median']:.1f} mm" if answered else "–",
        ]  # fmt: skip
        lines.append(f"| {name} | {in_words(row['within_3_cm_and_0.1_deg'])} | {' | '.join(cells)} |")
    return "\n".join(lines)
