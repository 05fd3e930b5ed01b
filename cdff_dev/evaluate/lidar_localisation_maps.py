# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar localisation on maps that others made, and what each way to search the whole map finds alone.

The maps are of the same 40 sweeps of the ground of ``lidar_localisation``: what ``lidar_slam`` exports after it was
given them; the clouds of a DPM, each put down with the errors of a survey; elevation patches of the same in a DPM. On
each the robot drives half a metre beside the way that was mapped, with odometry that drifts by 1 % and 0.1 degrees a
step. The first sweep is searched for without a guess; on the map of lidar_slam, whose frame is its first sweep's and as
tilted as the lidar, it has one. There the truth is relative to that sweep: the drift of the map counts.

Searched for without guess or prediction: the sweeps of ``lidar_localisation``, which are rings on smooth ground, and
clouds spread evenly over fractal ground with rocks, beside them those of ground that the map does not show.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
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
from cdff_dev.evaluate._terrain import SENSOR_M, Terrain
from cdff_dev.evaluate.lidar_localisation import LIMIT_DEG, LIMIT_M, MAP_TIMES_S, WRONG_M, Place, place, trial
from cdff_dev.evaluate.record import spread
from cdff_dev.registration.rates import in_words, interval, pose_errors
from cdff_dev.simulate.drive import settle
from dpm_store import Parcel, Query, open_store
from dpm_store.windows import WindowQuery

#: Its page and what else is there are those of this evaluation.
PAGE = "lidar_localisation"

WAYS = ("shape", "descriptors")
SWEEPS, ASIDE_M = 40, 0.5
SEARCHES = 30
CELL_M, CLOUD_VOXEL_M, MOST_POINTS = 0.1, 0.15, 1_000_000
SPREAD_M, SPREAD_POINTS = 18.0, 12_000
#: A map tilted by more is not searched by the shape of the ground.
LEVEL_DEG = 3.0
_GUESS_OFF = np.array([1.0, 0.0, 0.0, 0.0, 0.0, np.radians(10.0)])
_DRIFT = np.array([0.01, 0.0, 0.0, 0.0, 0.0, np.radians(0.1)])


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Drives on each map, searches by each way."""
    ground = place()
    drives: dict[str, Any] = {}
    for name, (sample, T_map_site) in maps(ground).items():
        progress(f"lidar localisation: drive on the map of {name}")
        drives[name] = driven(ground, sample, T_map_site)
    return {"drives": drives, "searches": {way: searched(way, progress) for way in WAYS}}


def maps(ground: Place) -> dict[str, tuple[Sample, FloatArray]]:
    """Each map as the sample that brings it, and ``T_map_site``."""
    T_site_first = ground.surveyed()[0][0]
    clouds, patches = from_dpm(ground)
    return {
        "lidar_slam": (Sample("graph_map", 0, 0, of_slam(ground)), se3.inverse(T_site_first)),
        "clouds of a DPM": (Sample("map", 0, 0, clouds), np.eye(4)),
        "elevation of a DPM": (Sample("dem", 0, 0, patches), np.eye(4)),
    }


def of_slam(ground: Place) -> LidarMap:
    """What lidar_slam exports after the sweeps of the survey."""
    slam = Registry.default().make_dfpc("lidar_slam")
    slam.configure({})
    for (_, points), t_s in zip(ground.surveyed(), MAP_TIMES_S, strict=True):
        list(slam.step(Sample("scan", round(t_s * NS_PER_S), 0, at_rest(points, round(t_s * NS_PER_S)))))
    list(slam.finish())
    exported: LidarMap = slam.call("export_map", {})
    return exported


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


def driven(ground: Place, sample: Sample, T_map_site: FloatArray) -> dict[str, Any]:
    """Errors of a drive on a map, its first sweep without a guess where z of the map is up."""
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure({})
    list(dfpc.step(sample))
    rng = np.random.default_rng(4)
    mount = ground.scenario.lidar.mount.matrix()
    is_level = T_map_site[2, 2] > np.cos(np.radians(LEVEL_DEG))
    before, felt, errors, refused = None, np.eye(4), [], 0
    for i, t_s in enumerate(np.linspace(MAP_TIMES_S[0], MAP_TIMES_S[-1], SWEEPS)):
        T = ground.on_the_way(t_s)
        xy = T[:2, 3] + ASIDE_M * T[:2, 1]
        T = settle(ground.relief, ground.scenario.chassis, xy[None], np.array([np.arctan2(T[1, 0], T[0, 0])]))[0]
        points, T = ground.sweep(T, rng), T @ mount
        if before is not None:
            step = se3.inverse(before) @ T
            felt = felt @ step @ se3.exp_se3(_DRIFT * np.r_[np.full(3, np.linalg.norm(step[:3, 3])), np.ones(3)])
        if before is None and not is_level:
            off = UncertainTransform(T_map_site @ T @ se3.exp_se3(_GUESS_OFF))
            value = TransformWithCovariance.from_transform(
                off, parent=dfpc.store.get("scan_map").frame, child="lidar", stamp_ns=0
            )
            list(dfpc.step(Sample("guess", 0, 0, value)))
        before, stamp_ns = T, i * NS_PER_S
        odometry = TransformWithCovariance.from_transform(
            UncertainTransform(felt), parent="odom", child="lidar", stamp_ns=stamp_ns
        )
        list(dfpc.step(Sample("odometry", stamp_ns, i, odometry)))
        (output,) = dfpc.step(Sample("scan", stamp_ns, i, at_rest(points, stamp_ns)))
        if output.quality.status is Status.FAILED:
            refused += 1
        else:
            errors.append(pose_errors(output.value.transform.matrix, T_map_site @ T))
    good = sum(m <= LIMIT_M and d <= LIMIT_DEG for m, d in errors)
    return {
        "sweeps": SWEEPS, "begun": "without a guess" if is_level else "from 1 m and 10 deg off",
        "within_3_cm_and_0.1_deg": interval(good, SWEEPS), "refused": refused,
        "wrong": interval(sum(m > WRONG_M for m, _ in errors), SWEEPS),
        "error_m": spread([m for m, _ in errors], 5), "error_deg": spread([d for _, d in errors], 5),
    }  # fmt: skip


def searched(way: str, progress: Callable[[str], None]) -> dict[str, Any]:
    """What one way finds on the whole map: rings on smooth ground, even clouds on fractal ground, and elsewhere."""
    rings, even, elsewhere = [], [], []
    ground, fractal, other = place(), Terrain(0), Terrain(1)
    on_smooth, on_fractal = searching(way, ground.map(0)), searching(way, surface(fractal))
    for seed in range(SEARCHES):
        progress(f"lidar localisation: searched by {way}, {seed} of {SEARCHES}")
        T, points, _ = trial(ground, seed)
        rings.append(_answer(on_smooth, points, T))
        T, points = even_sweep(fractal, seed)
        even.append(_answer(on_fractal, points, T))
        _, points = even_sweep(other, seed)
        elsewhere.append(_answer(on_fractal, points, None))
    return {
        "rings on smooth ground": _found(rings), "even clouds on fractal ground": _found(even),
        "accepted where the map does not show it": interval(sum(a is not None for a in elsewhere), SEARCHES),
    }  # fmt: skip


def surface(ground: Terrain) -> FloatArray:
    """A map (300 000, 3) of fractal ground, the whole of it."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(1.0, ground.size_m - 1.0, (300_000, 2))
    return np.c_[xy, ground.height(xy) + rng.normal(0.0, 0.01, len(xy))]


def even_sweep(ground: Terrain, seed: int) -> tuple[FloatArray, FloatArray]:
    """``T_map_lidar`` of a robot that stands level, and points (12 000, 3) spread over 18 m about it, 1 cm noise."""
    rng = np.random.default_rng([seed, 5])
    xy, heading = rng.uniform(SPREAD_M + 2.0, ground.size_m - SPREAD_M - 2.0, 2), rng.uniform(-np.pi, np.pi)
    T = se3.transform(se3.exp_so3([0.0, 0.0, heading]), [*xy, ground.height(xy[None])[0] + SENSOR_M])
    r, a = SPREAD_M * np.sqrt(rng.random(SPREAD_POINTS)), rng.uniform(-np.pi, np.pi, SPREAD_POINTS)
    seen = xy + np.column_stack([r * np.cos(a), r * np.sin(a)])
    points = np.c_[seen, ground.height(seen) + rng.normal(0.0, 0.01, SPREAD_POINTS)]
    return T, se3.transform_points(se3.inverse(T), points)


def searching(way: str, points_m: FloatArray) -> Dfpc:
    """Lidar localisation on a map, which it searches by one way only."""
    dfpc = Registry.default().make_dfpc("lidar_localisation")
    dfpc.configure({"relocalise_by": [way]})
    list(dfpc.step(Sample("map", 0, 0, Pointcloud.from_points(points_m, frame="site", stamp_ns=0))))
    return dfpc


def at_rest(points_m: FloatArray, stamp_ns: int) -> LidarScan:
    """A sweep whose points were all taken at once."""
    at_once = np.zeros(len(points_m), np.uint32)
    return LidarScan.from_arrays(points_m.astype(np.float32), at_once, frame="lidar", t0_ns=stamp_ns, t1_ns=stamp_ns)


def _answer(dfpc: Dfpc, points_m: FloatArray, T_true: FloatArray | None) -> tuple[float, float] | None:
    """Errors of the answer, 0 where there is no truth; None where it is refused."""
    dfpc.call("relocalise", {})
    (output,) = dfpc.step(Sample("scan", 0, 0, at_rest(points_m, 0)))
    if output.quality.status is Status.FAILED:
        return None
    return (0.0, 0.0) if T_true is None else pose_errors(output.value.transform.matrix, T_true)


def _found(answers: list[tuple[float, float] | None]) -> dict[str, Any]:
    right = sum(a is not None and a[0] <= LIMIT_M and a[1] <= LIMIT_DEG for a in answers)
    wrong = sum(a is not None and a[0] > WRONG_M for a in answers)
    return {
        "within_3_cm_and_0.1_deg": interval(right, len(answers)), "wrong": interval(wrong, len(answers)),
        "refused": sum(a is None for a in answers),
    }  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """Drives on each map, and searches by each way."""
    lines = [
        "| drive on the map of | begun | within 3 cm and 0.1° | median error | greatest | refused | wrong |",
        "|---" * 7 + "|",
    ]
    for name, row in figures["drives"].items():
        m, d = row["error_m"], row["error_deg"]
        error = f"{1e3 * m['median']:.1f} mm, {d['median']:.3f}°" if m["count"] else "–"
        greatest = f"{1e3 * m['max']:.1f} mm, {d['max']:.3f}°" if m["count"] else "–"
        lines.append(
            f"| {name} | {row['begun'].replace(' deg', '°')} | {in_words(row['within_3_cm_and_0.1_deg'])} | {error} "
            f"| {greatest} | {row['refused']} | {in_words(row['wrong'])} |"
        )
    lines += ["", "| searched, no guess | by shape | by descriptors |", "|---|---|---|"]
    for name in figures["searches"][WAYS[0]]:
        cells = []
        for way in WAYS:
            row = figures["searches"][way][name]
            if "refused" in row:
                cells.append(f"{in_words(row['within_3_cm_and_0.1_deg'])}, {row['refused']} refused")
            else:
                cells.append(in_words(row))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)
