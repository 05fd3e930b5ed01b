# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cost of the DFNs of target_detection and of the compound, on scans of the satellite Tango by ray casting.

NUMBA_NUM_THREADS=1 python benchmarks/object_models.py [--data DIR] [--rounds N] [--out FILE]
"""

from __future__ import annotations

import argparse
import os
import platform
from functools import partial
from pathlib import Path
from typing import Any

from _report import measure, write_report

from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from cdff_core.dfns.model_pose_refinement.interface import ModelPoseRefinementInputs
from cdff_core.dfns.model_pose_search.interface import ModelPoseSearchInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from evaluation.scenes.target_scans import SENSORS, model_sample, random_scan, tango


def node(name: str) -> Any:
    """Return a configured DFN."""
    dfn = Registry.default().make_dfn(name)
    dfn.configure()
    return dfn


def costs(data: Path, rounds: int) -> dict[str, Any]:
    """Return CPU seconds and memory of each DFN and of the compound."""
    body = tango(data)
    preparation = ModelPreparationInputs(vertices=body.vertices, triangles=body.triangles)
    prepare = node("model_preparation")
    report: dict[str, Any] = {"ModelPreparation": measure(partial(prepare.process, preparation), 1)}
    model = prepare.process(preparation)
    names = ("points", "normals", "grid_index", "grid_low", "grid_cell_m", "diameter_m")
    surface = {name: getattr(model, name) for name in names}
    search, refine = node("model_pose_search"), node("model_pose_refinement")
    detection = Registry.default().make_dfpc("target_detection")
    detection.configure()
    list(detection.step(model_sample(body, "tango")))
    for name, sensor in SENSORS.items():
        scan = random_scan(body, sensor, seed=1).points_m
        views = {"view_directions": model.view_directions, "view_centroids": model.view_centroids}
        of_search = ModelPoseSearchInputs(scan=scan, sigma_m=sensor.sigma_m, **views, **surface)
        of_refinement = ModelPoseRefinementInputs(
            scan=scan,
            poses=search.process(of_search).poses,
            drawn_vertices=model.drawn_vertices,
            drawn_triangles=model.drawn_triangles,
            centre_m=model.centre_m,
            sigma_m=sensor.sigma_m,
            **surface,
        )
        sample = Sample("cloud", 0, 0, Pointcloud.from_points(scan, frame="lidar", stamp_ns=0))
        report[name] = {
            "points": len(scan),
            "ModelPoseSearch": measure(partial(search.process, of_search), rounds),
            "ModelPoseRefinement": measure(partial(refine.process, of_refinement), rounds),
            "TargetDetection": measure(partial(lambda s: list(detection.step(s)), sample), rounds),
        }
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default_data = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or default_data))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {
        "benchmark": "object_models",
        "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        **costs(args.data, args.rounds),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
