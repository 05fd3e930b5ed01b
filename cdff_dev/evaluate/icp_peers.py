# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""icp_localisation beside small_gicp, Open3D and KISS-ICP, all in one run on the same clouds, from the identity.

Everyone gets the raw clouds and the same guess, on one thread. CPU seconds include filtering, thinning and normals, and
of ours also the assessment and the confirmation. small_gicp and Open3D run with their defaults at a voxel of 0.25 m;
where a peer has no coarse level it is given none. KISS-ICP is an odometry, not a pairwise registration: it sees both
scans as two frames, in a process of its own. Simulated scans are those of ``icp_localisation``; KISS-ICP takes part
there only, since it takes no guess.
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

from cdff_dev.evaluate._clouds import kitti_pair, small_gicp_pair
from cdff_dev.evaluate._icp import IMPLEMENTATIONS, localised, made
from cdff_dev.evaluate._peers import kiss_icp, peer_python
from cdff_dev.evaluate._terrain import scan_pair
from cdff_dev.registration.rates import pose_errors

Points = NDArray[np.float64]
Method = Callable[[Points, Points, Points], tuple[Points | None, dict[str, Any]]]

#: Its page and what else is there are those of this evaluation.
PAGE = "icp_localisation"

#: Seeds of the simulated scans: none that a calibration learnt from.
FIRST_SEED = 4000
TERRAIN_PAIRS, ROUNDS = 8, 1
VOXEL_M = 0.25
#: Names of the measured pairs in the table.
_PAIRS = {"kitti_94_95": "KITTI 00, 94→95", "small_gicp_pair": "small_gicp's pair"}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Errors and CPU time of everyone."""
    progress("icp_localisation beside its peers")
    return {
        "load_1min": round(os.getloadavg()[0], 1), "voxel_m_of_peers": VOXEL_M,
        "simulated_scans": on_terrain(TERRAIN_PAIRS, peer_python("kiss_icp")), "pairs": on_pairs(data, ROUNDS),
    }  # fmt: skip


def pairs(data: Path) -> Iterator[tuple[str, Points, Points, Points]]:
    """Name, scene, model and T_scene_model of the pairs that begin from the identity."""
    for name, read in (("kitti_94_95", kitti_pair), ("small_gicp_pair", small_gicp_pair)):
        source, target, T = read(data)
        yield name, target, source, T


def ours(implementation: str) -> Method:
    """The DFPC with an implementation's shipped configuration."""
    dfpc = made(implementation)

    def run(scene: Points, model: Points, guess: Points) -> tuple[Points | None, dict[str, Any]]:
        output, _ = localised(dfpc, scene, model, guess)
        said = {"status": str(output.quality.status), "reasons": list(output.quality.reasons)}
        if output.value is None:
            return None, said
        T = output.value.transform
        return T.matrix, {**said, "covariance": T.covariance}

    return run


def small_gicp_method(kind: str) -> Method:
    """small_gicp's align with its defaults."""

    def run(scene: Points, model: Points, guess: Points) -> tuple[Points | None, dict[str, Any]]:
        import small_gicp

        found = small_gicp.align(
            scene, model, guess, registration_type=kind, downsampling_resolution=VOXEL_M, num_threads=1
        )
        return np.array(found.T_target_source), {"converged": bool(found.converged)}

    return run


def open3d_method(kind: str) -> Method:
    """Open3D's legacy pipeline: voxels, normals, one level."""

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
            found = registration.registration_generalized_icp(clouds[1], clouds[0], 1.0, guess, estimation, criteria)
        else:
            estimation = registration.TransformationEstimationPointToPlane(registration.TukeyLoss(0.3))
            found = registration.registration_icp(clouds[1], clouds[0], 1.0, guess, estimation, criteria)
        return np.array(found.transformation), {"fitness": float(found.fitness)}

    return run


def methods() -> dict[str, Method]:
    """Everyone who takes part; a peer that is not installed is left out."""
    found: dict[str, Method] = {f"cdff {i}": ours(i) for i in IMPLEMENTATIONS}
    try:
        import small_gicp  # noqa: F401

        found |= {f"small_gicp {kind}": small_gicp_method(kind) for kind in ("GICP", "PLANE_ICP")}
    except ImportError:
        pass
    try:
        import open3d  # noqa: F401

        found |= {"open3d point-to-plane Tukey": open3d_method("plane"), "open3d GICP": open3d_method("gicp")}
    except ImportError:
        pass
    return found


def errors(T: Points, T_true: Points) -> dict[str, float]:
    """Distance of the translations and angle between the rotations."""
    return dict(zip(("error_m", "error_deg"), pose_errors(T, T_true), strict=True))


def on_terrain(count: int, peer: str | None) -> dict[str, Any]:
    """Median and greatest error and median CPU time of everyone on simulated scans, from the identity."""
    taking_part = methods()
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in taking_part}
    scans = [scan_pair(seed) for seed in range(FIRST_SEED, FIRST_SEED + count)]
    for index, (scene, model, T_true) in enumerate([scans[0], *scans]):  # the first time warms up
        for name, run in taking_part.items():
            started = time.process_time()
            T, _ = run(scene, model, np.eye(4))
            cpu_s = time.process_time() - started
            if T is not None and index:
                rows[name].append((*pose_errors(T, T_true), cpu_s))
    if peer:
        found = kiss_icp(peer, [(model, scene) for scene, model, _ in [scans[0], *scans]])[1:]
        rows["KISS-ICP, as two frames of its odometry"] = [
            (*pose_errors(T, T_true), cpu_s)
            for (T, cpu_s), (*_, T_true) in zip(found, scans, strict=True)
            if T is not None
        ]
    return {
        "pairs": count, "points": len(scans[0][0]),
        "methods": {
            name: {
                "answered": len(row), "median_m": round(float(np.median([r[0] for r in row])), 5),
                "max_m": round(max(r[0] for r in row), 5),
                "median_deg": round(float(np.median([r[1] for r in row])), 4),
                "median_cpu_s": round(float(np.median([r[2] for r in row])), 4),
            }
            for name, row in rows.items() if row
        },
    }  # fmt: skip


def on_pairs(data: Path, rounds: int) -> dict[str, Any]:
    """Every method on every pair, in turns."""
    report: dict[str, Any] = {}
    taking_part = methods()
    for name, scene, model, T_true in pairs(data):
        rows: dict[str, Any] = {method: {"cpu_s": []} for method in taking_part}
        for _ in range(rounds + 1):  # the first round warms up
            for method, run in taking_part.items():
                started = time.process_time()
                T, said = run(scene, model, np.eye(4))
                rows[method]["cpu_s"].append(time.process_time() - started)
                stated = said.pop("covariance", None)
                rows[method] |= said | ({} if T is None else errors(T, T_true))
                if T is not None and stated is not None:
                    rows[method]["sigma_m"] = [float(v) for v in np.sqrt(np.diag(stated))[:3]]
        for row in rows.values():
            row["cpu_s"] = statistics.median(row["cpu_s"][1:])
        report[name] = rows
    return report


def table(figures: dict[str, Any]) -> str:
    """Everyone on simulated scans and on the measured pairs."""
    rows, pairs_ = figures["simulated_scans"], figures["pairs"]
    lines = [
        f"| | {rows['pairs']} simulated pairs, median error | greatest | CPU ms | {' | '.join(_PAIRS.values())} |",
        "|---" * 6 + "|",
    ]
    for name, row in rows["methods"].items():
        cells = []
        for pair in _PAIRS:
            found = pairs_[pair].get(name)
            if found is None:
                cells.append("–")
            elif "error_m" not in found:
                cells.append("refused")
            else:
                cells.append(
                    f"{1e3 * found['error_m']:.1f} mm, {found['error_deg']:.3f}°, {1e3 * found['cpu_s']:.0f} ms"
                )
        title = f"**{name.removeprefix('cdff ')}**" if name.startswith("cdff ") else name
        lines.append(
            f"| {title} | {1e3 * row['median_m']:.1f} mm, {row['median_deg']:.3f}° | {1e3 * row['max_m']:.1f} mm "
            f"| {1e3 * row['median_cpu_s']:.0f} | {' | '.join(cells)} |"
        )
    return "\n".join([*lines, "", f"Load of the machine in that run: {figures['load_1min']}."])
