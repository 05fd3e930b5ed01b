# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""point_cloud_matching beside KISS-Matcher on a few terrain pairs, its solver among wrong pairs; cost of the DFNs.

OMP_NUM_THREADS=1 python benchmarks/point_cloud_matching.py [--data DIR] [--trials N] [--solver-trials N]
    [--peer-python PYTHON] [--out FILE]

Clouds and judgement are those of cdff_dev/evaluate/point_cloud_matching.py, whose figures over all trials are in
docs/evaluation. KISS-Matcher runs in an environment of its own (``--peer-python``, with kiss-matcher and numpy
installed). SHOT beside FPFH: ``python -m cdff_dev.evaluate shot_localisation``.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
from _report import give_out

from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.features_description_3d._interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_extraction_3d._interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_matching_3d._interface import FeaturesMatching3DInputs
from cdff_core.dfns.global_registration_3d._interface import GlobalRegistration3DInputs
from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs
from cdff_dev.evaluate import point_cloud_matching as evaluation
from cdff_dev.evaluate._clouds import small_gicp_pair


def on_terrain(trials: int) -> dict[str, Any]:
    """Recall, false accepts and CPU time of ours and of the peer."""
    found: evaluation.Found = {}
    for seed in range(trials):
        for name, methods in evaluation.on_terrain(seed).items():
            for method, trial in methods.items():
                found.setdefault(name, {}).setdefault(method, []).append(trial)
    return evaluation.of_terrain(found)


def node(name: str, implementation: str | None = None, **config: Any) -> Any:
    """A configured DFN."""
    made = Registry.default().make_dfn(name, implementation)
    made.configure(config)
    return made


def of_dfns(data: Path, rounds: int) -> dict[str, Any]:
    """CPU seconds and memory of each DFN, at the sizes that their descriptions name."""
    source, *_ = small_gicp_pair(data)
    voxel_m = voxel_for(source, 8000)
    points = voxel_means(source, voxel_m)
    normals = node("normals_estimation").process(NormalsEstimationInputs(points)).normals
    keypoints = node("features_extraction_3d", max_keypoints=1000).process(FeaturesExtraction3DInputs(points)).keypoints
    rng = np.random.default_rng(0)
    descriptors = [rng.random((2000, 352), np.float32) for _ in range(2)]
    pairs = [rng.uniform(-1, 1, (1000, 3)) for _ in range(2)]
    pairs[1][:20] = pairs[0][:20]
    described = FeaturesDescription3DInputs(points, normals, keypoints, np.array(10.0 * voxel_m))
    calls: dict[str, tuple[Any, Any]] = {
        "FeaturesExtraction3D/Uniform": (node("features_extraction_3d"), FeaturesExtraction3DInputs(points)),
        "FeaturesExtraction3D/Harris": (node("features_extraction_3d", "Harris"), FeaturesExtraction3DInputs(points)),
        "FeaturesExtraction3D/Iss": (node("features_extraction_3d", "Iss"), FeaturesExtraction3DInputs(points)),
        "FeaturesDescription3D/Shot": (node("features_description_3d"), described),
        "FeaturesDescription3D/Fpfh": (node("features_description_3d", "Fpfh"), described),
        "FeaturesMatching3D/MutualRatio": (node("features_matching_3d"), FeaturesMatching3DInputs(*descriptors)),
        "GlobalRegistration3D/CliqueGnc": (
            node("global_registration_3d", noise_m=0.03), GlobalRegistration3DInputs(*pairs)
        ),
    }  # fmt: skip
    report = {}
    for name, (dfn, inputs) in calls.items():
        dfn.process(inputs)
        times = []
        for _ in range(rounds):
            started = time.process_time()
            dfn.process(inputs)
            times.append(time.process_time() - started)
        tracemalloc.start()
        dfn.process(inputs)
        report[name] = {"cpu_s": statistics.median(times), "memory_mb": tracemalloc.get_traced_memory()[1] / 1e6}
        tracemalloc.stop()
    report["sizes"] = {"points": len(points), "keypoints": len(keypoints)}
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or beside))
    parser.add_argument("--trials", type=int, default=5, help="per row")
    parser.add_argument("--solver-trials", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--peer-python", help="interpreter of an environment with kiss-matcher")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if args.peer_python:
        os.environ["CDFF_PEER_PYTHON"] = args.peer_python
    report = {
        "benchmark": "point_cloud_matching", "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"), "load_1min": os.getloadavg()[0],
        "solver": evaluation.of_solver(args.solver_trials), "dfns": of_dfns(args.data, args.rounds),
    }  # fmt: skip
    if args.trials:
        report["simulated_terrain"] = on_terrain(args.trials)
    give_out(report, args.out)


if __name__ == "__main__":
    main()
