# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""icp_localisation beside small_gicp, Open3D and KISS-ICP, on simulated and measured clouds; cost of its DFNs.

OMP_NUM_THREADS=1 python benchmarks/icp.py [--data DIR] [--rounds N] [--terrain-pairs N] [--devon-trials N]
    [--peer-python PYTHON] [--out FILE]

Everyone gets the raw clouds and the same guess, on one thread. CPU seconds include filtering, thinning and normals, and
of ours also the assessment and the confirmation. small_gicp and Open3D run with their defaults at a voxel of 0.25 m;
where a peer has no coarse level it is given none. KISS-ICP is an odometry, not a pairwise registration: it sees both
scans as two frames, in an environment of its own (``--peer-python``, with kiss-icp and numpy installed). Simulated
scans: see cdff_dev/evaluate/icp_localisation.py; KISS-ICP takes part there only, since it takes no guess.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import covariance, se3
from cdff_common.interfaces.registry import Registry
from cdff_dev.evaluate._clouds import devon_halves, kitti_pair, small_gicp_pair
from cdff_dev.evaluate._icp import IMPLEMENTATIONS, localised, made
from cdff_dev.evaluate._peers import kiss_icp
from cdff_dev.evaluate._terrain import scan_pair
from cdff_dev.registration.rates import pose_errors

Points = NDArray[np.float64]
Method = Callable[[Points, Points, Points], tuple[Points | None, dict[str, Any]]]
VOXEL_M = 0.25


def pairs(data: Path) -> Iterator[tuple[str, Points, Points, Points]]:
    """Name, scene, model and T_scene_model of the pairs that begin from the identity."""
    for name, read in (("kitti_94_95", kitti_pair), ("small_gicp_pair", small_gicp_pair)):
        source, target, T = read(data)
        yield name, target, source, T


def devon_trials(data: Path, trials: int) -> Iterator[tuple[Points, Points, Points, Points]]:
    """Scene, model, truth and guess: disjoint halves of the road and its copy, guesses off by 0.5 m and 10 degrees."""
    for seed in range(trials):
        model, scene, T = devon_halves(data, seed)
        axis, shift = (v / np.linalg.norm(v) for v in np.random.default_rng([seed, 1]).normal(size=(2, 3)))
        off = se3.transform(se3.exp_so3(np.radians(10.0) * axis), 0.5 * shift)
        yield scene, model, T, T @ off if seed % 2 else off @ T


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
    scans = [scan_pair(3000 + seed) for seed in range(count)]
    for index, (scene, model, T_true) in enumerate([scans[0], *scans]):  # the first time warms up
        for name, run in taking_part.items():
            started = time.process_time()
            T, _ = run(scene, model, np.eye(4))
            cpu_s = time.process_time() - started
            if T is not None and index:
                rows[name].append((*pose_errors(T, T_true), cpu_s))
    if peer:
        found = kiss_icp(peer, [(model, scene) for scene, model, _ in [scans[0], *scans]])[1:]
        rows["kiss_icp, two frames"] = [
            (*pose_errors(T, T_true), cpu_s)
            for (T, cpu_s), (*_, T_true) in zip(found, scans, strict=True)
            if T is not None
        ]
    return {
        "pairs": count, "points": len(scans[0][0]),
        "methods": {
            name: {
                "answered": len(row), "median_m": float(np.median([r[0] for r in row])),
                "max_m": max(r[0] for r in row), "median_deg": float(np.median([r[1] for r in row])),
                "median_cpu_s": float(np.median([r[2] for r in row])),
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


def on_devon(data: Path, trials: int) -> dict[str, Any]:
    """Every method on the trials of the road; within 2 cm and 0.1 degrees is right."""
    taking_part = methods()
    rows: dict[str, Any] = {m: {"right": 0, "wrong": 0, "refused": 0, "error_m": [], "nees": []} for m in taking_part}
    for scene, model, T_true, guess in devon_trials(data, trials):
        for method, run in taking_part.items():
            row = rows[method]
            T, said = run(scene, model, guess)
            if T is None:
                row["refused"] += 1
                continue
            error = errors(T, T_true)
            row["right" if error["error_m"] <= 0.02 and error["error_deg"] <= 0.1 else "wrong"] += 1
            row["error_m"].append(error["error_m"])
            if "covariance" in said:
                e = covariance.pose_error(T_true, T)
                row["nees"].append(float(e @ np.linalg.solve(said["covariance"], e)))
    for row in rows.values():
        found, nees = row.pop("error_m"), row.pop("nees")
        row |= {"median_error_m": float(np.median(found)), "max_error_m": float(np.max(found))} if found else {}
        row |= {"mean_nees": float(np.mean(nees))} if nees else {}
    return {"trials": trials, "methods": rows}


def of_dfns(data: Path, rounds: int) -> dict[str, Any]:
    """CPU seconds and memory of each DFN on the first pair."""
    from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs
    from cdff_core.dfns.point_cloud_assembly._interface import PointCloudAssemblyInputs
    from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
    from cdff_core.dfns.point_cloud_filtering._interface import PointCloudFilteringInputs
    from cdff_core.dfns.point_cloud_transformation._interface import PointCloudTransformationInputs
    from cdff_core.dfns.registration_3d._interface import Registration3DInputs
    from cdff_core.dfns.registration_assessment._interface import RegistrationAssessmentInputs
    from cdff_core.dfns.voxelization._interface import VoxelizationInputs

    def node(name: str, implementation: str | None = None) -> Any:
        made = Registry.default().make_dfn(name, implementation)
        made.configure()
        return made

    _, scene, model, T = next(pairs(data))
    thin, normals = node("point_cloud_downsampling"), node("normals_estimation")
    s, m = (thin.process(PointCloudDownsamplingInputs(cloud)).points for cloud in (scene, model))
    ns, nm = (normals.process(NormalsEstimationInputs(cloud)).normals for cloud in (s, m))
    calls: dict[str, tuple[Any, Any, str]] = {
        "PointCloudFiltering/RangeFilter": (
            node("point_cloud_filtering", "RangeFilter"), PointCloudFilteringInputs(scene), f"{len(scene)} points"
        ),
        "PointCloudFiltering/StatisticalOutlierRemoval": (
            node("point_cloud_filtering", "StatisticalOutlierRemoval"), PointCloudFilteringInputs(s), f"{len(s)} points"
        ),
        "PointCloudDownsampling/VoxelGrid": (
            thin, PointCloudDownsamplingInputs(scene), f"{len(scene)} points to {len(s)}"
        ),
        **{
            f"PointCloudAssembly/{i}": (
                node("point_cloud_assembly", i), PointCloudAssemblyInputs(scene, model), f"{len(scene)} + {len(model)}"
            )
            for i in ("VoxelBinning", "NeighbourPointAverage")
        },
        "Voxelization/Octree": (node("voxelization"), VoxelizationInputs(scene), f"{len(scene)} points"),
        "NormalsEstimation/PrincipalAxis": (normals, NormalsEstimationInputs(s), f"{len(s)} points"),
        "PointCloudTransformation/CartesianSystemTransform": (
            node("point_cloud_transformation"), PointCloudTransformationInputs(scene, T), f"{len(scene)} points"
        ),
        "RegistrationAssessment/CrossInformation": (
            node("registration_assessment"), RegistrationAssessmentInputs(m, nm, s, ns, T), f"{len(m)} and {len(s)}"
        ),
    }  # fmt: skip
    for implementation in ("PointToPlaneIcp", "Gicp", "Ndt"):
        registration = node("registration_3d", implementation)
        calls[f"Registration3D/{implementation}"] = (
            registration, Registration3DInputs(m, s, ns, np.eye(4)), f"{len(m)} to {len(s)} points, 1.1 m apart"
        )  # fmt: skip
    report = {}
    for name, (dfn, inputs, size) in calls.items():
        dfn.process(inputs)
        times = []
        for _ in range(rounds):
            started = time.process_time()
            dfn.process(inputs)
            times.append(time.process_time() - started)
        tracemalloc.start()
        dfn.process(inputs)
        memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        report[name] = {"input": size, "cpu_s": statistics.median(times), "memory_mb": memory_mb}
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or beside))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--terrain-pairs", type=int, default=12)
    parser.add_argument("--peer-python", default=os.environ.get("CDFF_PEER_PYTHON"), help="interpreter with kiss-icp")
    parser.add_argument("--devon-trials", type=int, default=10)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {
        "benchmark": "icp", "python": platform.python_version(), "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        "load_1min": os.getloadavg()[0], "voxel_m_of_peers": VOXEL_M,
        "pairs": on_pairs(args.data, args.rounds), "dfns": of_dfns(args.data, args.rounds),
    }  # fmt: skip
    if args.terrain_pairs:
        report["simulated_scans"] = on_terrain(args.terrain_pairs, args.peer_python)
    if args.devon_trials:
        report["devon_island"] = on_devon(args.data, args.devon_trials)
    text = json.dumps(report, indent=1)
    print(text)
    if args.out:
        args.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
