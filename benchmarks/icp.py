# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare icp_localisation with small_gicp, Open3D and KISS-ICP; measure the cost of its DFNs.

OMP_NUM_THREADS=1 python benchmarks/icp.py [--data DIR] [--rounds N] [--terrain-pairs N] [--devon-trials N]
    [--peer-python PYTHON] [--out FILE]

Methods and settings: evaluation/icp_peers.py, whose table is in docs/evaluation/icp_localisation.md.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _report import measure, write_report
from numpy.typing import NDArray

from cdff_common.geometry import covariance, se3
from cdff_common.interfaces.registry import Registry
from evaluation.data_sets.clouds import devon_halves
from evaluation.icp_peers import VOXEL_M, compare_on_pairs, compare_on_scans, errors, methods, pairs
from evaluation.peers.environments import peer_python

Points = NDArray[np.float64]


def devon_trials(data: Path, trials: int) -> Iterator[tuple[Points, Points, Points, Points]]:
    """Yield scene, model, true pose and guess: halves of the road and its copy; guess errors of 0.5 m and 10
    deg.
    """
    for seed in range(trials):
        model, scene, T = devon_halves(data, seed)
        rng = np.random.default_rng([seed, 1])
        axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        T_error = se3.transform(se3.exp_so3(np.radians(10.0) * axis), 0.5 * direction)
        yield scene, model, T, T @ T_error if seed % 2 else T_error @ T


def on_devon(data: Path, trials: int) -> dict[str, Any]:
    """Return the results of all methods on the road; a pose is correct within 2 cm and 0.1 degrees."""
    all_methods = methods()
    rows: dict[str, Any] = {
        m: {"correct": 0, "wrong": 0, "refused": 0, "error_m": [], "nees": []} for m in all_methods
    }
    for scene, model, T_true, guess in devon_trials(data, trials):
        for method, run in all_methods.items():
            row = rows[method]
            T, details = run(scene, model, guess)
            if T is None:
                row["refused"] += 1
                continue
            error = errors(T, T_true)
            row["correct" if error["error_m"] <= 0.02 and error["error_deg"] <= 0.1 else "wrong"] += 1
            row["error_m"].append(error["error_m"])
            if "covariance" in details:
                e = covariance.pose_error(T_true, T)
                row["nees"].append(float(e @ np.linalg.solve(details["covariance"], e)))
    for row in rows.values():
        errors_m, nees = row.pop("error_m"), row.pop("nees")
        row |= (
            {"median_error_m": float(np.median(errors_m)), "max_error_m": float(np.max(errors_m))}
            if errors_m
            else {}
        )
        row |= {"mean_nees": float(np.mean(nees))} if nees else {}
    return {"trials": trials, "methods": rows}


def dfn_costs(data: Path, rounds: int) -> dict[str, Any]:
    """Return CPU seconds and memory of each DFN on the first pair."""
    from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
    from cdff_core.dfns.point_cloud_assembly.interface import PointCloudAssemblyInputs
    from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
    from cdff_core.dfns.point_cloud_filtering.interface import PointCloudFilteringInputs
    from cdff_core.dfns.point_cloud_transformation.interface import PointCloudTransformationInputs
    from cdff_core.dfns.registration_3d.interface import Registration3DInputs
    from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentInputs
    from cdff_core.dfns.voxelization.interface import VoxelizationInputs

    def node(name: str, implementation: str | None = None) -> Any:
        dfn = Registry.default().make_dfn(name, implementation)
        dfn.configure()
        return dfn

    _, scene, model, T = next(pairs(data))
    downsample, estimate_normals = node("point_cloud_downsampling"), node("normals_estimation")
    scene_points, model_points = (
        downsample.process(PointCloudDownsamplingInputs(points=cloud)).points for cloud in (scene, model)
    )
    ns, nm = (
        estimate_normals.process(NormalsEstimationInputs(points=cloud)).normals
        for cloud in (scene_points, model_points)
    )
    calls: dict[str, tuple[Any, Any, str]] = {
        "PointCloudFiltering/RangeFilter": (
            node("point_cloud_filtering", "RangeFilter"),
            PointCloudFilteringInputs(points=scene),
            f"{len(scene)} points",
        ),
        "PointCloudFiltering/StatisticalOutlierRemoval": (
            node("point_cloud_filtering", "StatisticalOutlierRemoval"),
            PointCloudFilteringInputs(points=scene_points),
            f"{len(scene_points)} points",
        ),
        "PointCloudDownsampling/VoxelGrid": (
            downsample,
            PointCloudDownsamplingInputs(points=scene),
            f"{len(scene)} points to {len(scene_points)}",
        ),
        **{
            f"PointCloudAssembly/{i}": (
                node("point_cloud_assembly", i),
                PointCloudAssemblyInputs(first_points=scene, second_points=model),
                f"{len(scene)} + {len(model)}",
            )
            for i in ("VoxelBinning", "NeighbourPointAverage")
        },
        "Voxelization/Octree": (
            node("voxelization"),
            VoxelizationInputs(points=scene),
            f"{len(scene)} points",
        ),
        "NormalsEstimation/PrincipalAxis": (
            estimate_normals,
            NormalsEstimationInputs(points=scene_points),
            f"{len(scene_points)} points",
        ),
        "PointCloudTransformation/CartesianSystemTransform": (
            node("point_cloud_transformation"),
            PointCloudTransformationInputs(points=scene, transform=T),
            f"{len(scene)} points",
        ),
        "RegistrationAssessment/CrossInformation": (
            node("registration_assessment"),
            RegistrationAssessmentInputs(
                source=model_points, source_normals=nm, target=scene_points, target_normals=ns, transform=T
            ),
            f"{len(model_points)} and {len(scene_points)}",
        ),
    }
    for implementation in ("PointToPlaneIcp", "Gicp", "Ndt"):
        registration = node("registration_3d", implementation)
        calls[f"Registration3D/{implementation}"] = (
            registration,
            Registration3DInputs(
                source=model_points, target=scene_points, target_normals=ns, guess=np.eye(4)
            ),
            f"{len(model_points)} to {len(scene_points)} points, 1.1 m apart",
        )
    report = {}
    for name, (dfn, inputs, size) in calls.items():
        report[name] = {"input": size} | measure(partial(dfn.process, inputs), rounds)
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default_data = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or default_data))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--terrain-pairs", type=int, default=12)
    parser.add_argument("--peer-python", default=peer_python("kiss_icp"), help="interpreter with kiss-icp")
    parser.add_argument("--devon-trials", type=int, default=10)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {
        "benchmark": "icp",
        "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        "load_1min": os.getloadavg()[0],
        "voxel_m_of_peers": VOXEL_M,
        "pairs": compare_on_pairs(args.data, args.rounds),
        "dfns": dfn_costs(args.data, args.rounds),
    }
    if args.terrain_pairs:
        report["simulated_scans"] = compare_on_scans(args.terrain_pairs, args.peer_python)
    if args.devon_trials:
        report["devon_island"] = on_devon(args.data, args.devon_trials)
    write_report(report, args.out)


if __name__ == "__main__":
    main()
