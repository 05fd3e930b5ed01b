# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare icp_localisation with small_gicp, Open3D and KISS-ICP in one run on the same clouds.

All methods get the raw clouds and the identity as guess, and use one thread. CPU seconds include filtering,
downsampling and normals, and for icp_localisation the assessment and the confirmation. small_gicp and Open3D
use their defaults with voxels of 0.25 m, without coarse levels. On the measured pairs small_gicp also
gets voxels with which it keeps as many points as ``PointToPlane``, and ``PointToPlane`` is also run without
assessment and confirmation: the difference is the cost of its covariance.

KISS-ICP is an odometry, not a pairwise registration: it processes both scans as two frames, in a separate
process, and only the simulated scans of ``icp_localisation``, because it accepts no guess.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.voxels import voxel_for
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Pointcloud
from cdff_dev.compare.registration.rates import pose_errors
from evaluation.data_sets.clouds import kitti_pair, small_gicp_pair
from evaluation.peers.environments import kiss_icp, peer_python
from evaluation.real import RealRow
from evaluation.runs.icp import IMPLEMENTATIONS, localise, make_dfpc
from evaluation.scenes.terrain import scan_pair

Points = NDArray[np.float64]
Method = Callable[[Points, Points, Points], tuple[Points | None, dict[str, Any]]]

#: Page that contains the table of this evaluation.
PAGE = "icp_localisation"

#: First seed of the simulated scans; no calibration uses these seeds.
FIRST_SEED = 4000
TERRAIN_PAIRS, ROUNDS = 8, 1
VOXEL_M = 0.25
#: Number of points of the fine level of ``PointToPlane``.
_FINE_POINTS = 25_000
#: Suffixes of the names of the methods that are only run on measured pairs.
_REGISTRATION_ONLY, _AS_FINE = ", registration only", f", {_FINE_POINTS} points"
#: Names of the measured pairs in the table.
_PAIRS = {"kitti_94_95": "KITTI 00, 94→95", "small_gicp_pair": "small_gicp's pair"}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return errors and CPU time of all methods."""
    progress("icp_localisation and its peers")
    return {
        "load_1min": round(os.getloadavg()[0], 1),
        "voxel_m_of_peers": VOXEL_M,
        "simulated_scans": compare_on_scans(TERRAIN_PAIRS, peer_python("kiss_icp")),
        "pairs": compare_on_pairs(data, ROUNDS),
    }


def pairs(data: Path) -> Iterator[tuple[str, Points, Points, Points]]:
    """Yield name, scene, model and true T_scene_model of the measured pairs."""
    for name, read in (("kitti_94_95", kitti_pair), ("small_gicp_pair", small_gicp_pair)):
        source, target, T = read(data)
        yield name, target, source, T


def dfpc_method(implementation: str) -> Method:
    """Return the DFPC as a method, with the shipped configuration of an implementation."""
    dfpc = make_dfpc(implementation)

    def run(scene: Points, model: Points, guess: Points) -> tuple[Points | None, dict[str, Any]]:
        output, _ = localise(dfpc, scene, model, guess)
        report = {"status": str(output.quality.status), "reasons": list(output.quality.reasons)}
        if output.value is None:
            return None, report
        T = output.value.transform
        return T.matrix, {**report, "covariance": T.covariance}

    return run


def registration_only_method(implementation: str) -> Method:
    """Return the DFPC's preparation and registration, without assessment, covariance and confirmation."""
    dfpc = make_dfpc(implementation)

    def run(scene: Points, model: Points, guess: Points) -> tuple[Points | None, dict[str, Any]]:
        clouds = [
            dfpc._prepare(Sample(name, 0, 0, Pointcloud.from_points(points, frame=name, stamp_ns=0)))
            for name, points in (("scene", scene), ("model", model))
        ]
        return dfpc._register_levels(*clouds, guess, levels=3)[-1].transform, {}

    return run


def small_gicp_method(kind: str, voxel_m: float = VOXEL_M) -> Method:
    """Return small_gicp's ``align`` with default parameters."""

    def run(scene: Points, model: Points, guess: Points) -> tuple[Points | None, dict[str, Any]]:
        import small_gicp

        result = small_gicp.align(
            scene, model, guess, registration_type=kind, downsampling_resolution=voxel_m, num_threads=1
        )
        return np.array(result.T_target_source), {"converged": bool(result.converged)}

    return run


def open3d_method(kind: str) -> Method:
    """Return Open3D's legacy pipeline: voxel downsampling, normals, registration on one level."""

    def run(scene: Points, model: Points, guess: Points) -> tuple[Points | None, dict[str, Any]]:
        import open3d as o3d

        clouds = []
        for points in (scene, model):
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(VOXEL_M)
            cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
            clouds.append(cloud)
        registration = o3d.pipelines.registration
        criteria = registration.ICPConvergenceCriteria(1e-7, 1e-7, 50)
        if kind == "gicp":
            estimation = registration.TransformationEstimationForGeneralizedICP()
            result = registration.registration_generalized_icp(
                clouds[1], clouds[0], 1.0, guess, estimation, criteria
            )
        else:
            estimation = registration.TransformationEstimationPointToPlane(registration.TukeyLoss(0.3))
            result = registration.registration_icp(clouds[1], clouds[0], 1.0, guess, estimation, criteria)
        return np.array(result.transformation), {"fitness": float(result.fitness)}

    return run


def methods() -> dict[str, Method]:
    """Return all methods by name, without programs that are not installed."""
    results: dict[str, Method] = {f"cdff {i}": dfpc_method(i) for i in IMPLEMENTATIONS}
    try:
        import small_gicp  # noqa: F401

        results |= {f"small_gicp {kind}": small_gicp_method(kind) for kind in ("GICP", "PLANE_ICP")}
    except ImportError:
        pass
    try:
        import open3d  # noqa: F401

        results |= {
            "open3d point-to-plane Tukey": open3d_method("plane"),
            "open3d GICP": open3d_method("gicp"),
        }
    except ImportError:
        pass
    return results


def errors(T: Points, T_true: Points) -> dict[str, float]:
    """Return the translation error, metres, and the rotation error, degrees."""
    return dict(zip(("error_m", "error_deg"), pose_errors(T, T_true), strict=True))


def compare_on_scans(count: int, peer: str | None) -> dict[str, Any]:
    """Return median and maximum error and median CPU time of all methods on simulated scans."""
    all_methods = methods()
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in all_methods}
    scans = [scan_pair(seed) for seed in range(FIRST_SEED, FIRST_SEED + count)]
    for index, (scene, model, T_true) in enumerate([scans[0], *scans]):  # index 0 is a warm-up
        for name, run in all_methods.items():
            started = time.process_time()
            T, _ = run(scene, model, np.eye(4))
            cpu_s = time.process_time() - started
            if T is not None and index:
                rows[name].append((*pose_errors(T, T_true), cpu_s))
    if peer:
        result = kiss_icp(peer, [(model, scene) for scene, model, _ in [scans[0], *scans]])[1:]
        rows["KISS-ICP, as two frames of its odometry"] = [
            (*pose_errors(T, T_true), cpu_s)
            for (T, cpu_s), (*_, T_true) in zip(result, scans, strict=True)
            if T is not None
        ]
    return {
        "pairs": count,
        "points": len(scans[0][0]),
        "methods": {
            name: {
                "answered": len(row),
                "median_m": round(float(np.median([r[0] for r in row])), 5),
                "max_m": round(max(r[0] for r in row), 5),
                "median_deg": round(float(np.median([r[1] for r in row])), 4),
                "median_cpu_s": round(float(np.median([r[2] for r in row])), 4),
            }
            for name, row in rows.items()
            if row
        },
    }


def compare_on_pairs(data: Path, rounds: int) -> dict[str, Any]:
    """Return error and median CPU time of all methods on the measured pairs."""
    report: dict[str, Any] = {}
    shared_methods = methods()
    for name, scene, model, T_true in pairs(data):
        all_methods = shared_methods | _methods_on_pair(shared_methods, scene)
        rows: dict[str, Any] = {method: {"cpu_s": []} for method in all_methods}
        for _ in range(rounds + 1):  # the first round warms up
            for method, run in all_methods.items():
                started = time.process_time()
                T, details = run(scene, model, np.eye(4))
                rows[method]["cpu_s"].append(time.process_time() - started)
                stated_covariance = details.pop("covariance", None)
                rows[method] |= details | ({} if T is None else errors(T, T_true))
                if T is not None and stated_covariance is not None:
                    rows[method]["sigma_m"] = [float(v) for v in np.sqrt(np.diag(stated_covariance))[:3]]
        for row in rows.values():
            row["cpu_s"] = statistics.median(row["cpu_s"][1:])
        report[name] = rows
    return report


def _methods_on_pair(shared_methods: dict[str, Method], scene: Points) -> dict[str, Method]:
    """Return the methods that are only run on measured pairs, by name."""
    results = {f"cdff PointToPlane{_REGISTRATION_ONLY}": registration_only_method("PointToPlane")}
    voxel_m = voxel_for(scene, _FINE_POINTS)
    for kind in ("GICP", "PLANE_ICP"):
        if f"small_gicp {kind}" in shared_methods:
            results[f"small_gicp {kind}{_AS_FINE}"] = small_gicp_method(kind, voxel_m)
    return results


def table(figures: dict[str, Any]) -> str:
    """Return the table of all methods on simulated scans and measured pairs."""
    rows, pairs_ = figures["simulated_scans"], figures["pairs"]
    lines = [
        f"| | {rows['pairs']} simulated pairs, median error | maximum | CPU ms | "
        f"{' | '.join(_PAIRS.values())} |",
        "|---" * 6 + "|",
    ]
    simulated = rows["methods"]
    for name in dict.fromkeys([*simulated, *(name for pair in _PAIRS for name in pairs_[pair])]):
        title = f"**{name.removeprefix('cdff ')}**" if name.startswith("cdff ") else name
        cells = [*_cells_of_scans(simulated.get(name)), *(_cell_of_pair(pairs_[p].get(name)) for p in _PAIRS)]
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", f"Load average during the run: {figures['load_1min']}."])


def _cells_of_scans(row: dict[str, Any] | None) -> tuple[str, str, str]:
    """Return median error, maximum and CPU time of a method on the simulated scans."""
    if row is None:
        return "–", "–", "–"
    median = f"{1e3 * row['median_m']:.1f} mm, {row['median_deg']:.3f}°"
    return median, f"{1e3 * row['max_m']:.1f} mm", f"{1e3 * row['median_cpu_s']:.0f}"


def _cell_of_pair(result: dict[str, Any] | None) -> str:
    """Return error and CPU time of a method on a measured pair."""
    if result is None:
        return "–"
    if "error_m" not in result:
        return "refused"
    return f"{1e3 * result['error_m']:.1f} mm, {result['error_deg']:.3f}°, {1e3 * result['cpu_s']:.0f} ms"


def real_rows(figures: dict[str, Any]) -> list[RealRow]:
    """Return the rows of the table of results on real sensors."""
    rows = []
    for pair, previous in (("kitti_94_95", "3.5 ×"), ("small_gicp_pair", "17 ×")):
        methods = figures["pairs"][pair]
        peer_s = methods["small_gicp GICP"]["cpu_s"]
        ours, peers = (
            [
                f"{name.removeprefix(prefix)} {row['cpu_s'] / peer_s:.1f} ×, {1e3 * row['error_m']:.1f} mm"
                for name, row in methods.items()
                if name.startswith(shown_prefixes)
            ]
            for prefix, shown_prefixes in (
                ("cdff ", ("cdff PointToPlane", "cdff Quick")),
                ("small_gicp ", ("small_gicp ",)),
            )
        )
        quantity = f"{pair.replace('_', ' ')}, CPU time relative to small_gicp GICP, error"
        rows.append(RealRow(quantity, previous, "; ".join(ours), "; ".join(peers), "≤ 1.5 ×"))
    return rows
