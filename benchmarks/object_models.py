# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cost of the DFNs and compounds that detect and track the satellite Tango in scans and in a photograph.

NUMBA_NUM_THREADS=1 python benchmarks/object_models.py [--data DIR] [--rounds N] [--out FILE]
"""

from __future__ import annotations

import argparse
import itertools
import os
import platform
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _report import measure, write_report

from cdff_common.errors import CdffError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.dfns.image_pose_refinement.interface import ImagePoseRefinementInputs
from cdff_core.dfns.image_pose_search.interface import ImagePoseSearchInputs
from cdff_core.dfns.image_undistortion.interface import ImageUndistortionInputs
from cdff_core.dfns.model_pose_refinement.interface import ModelPoseRefinementInputs
from cdff_core.dfns.model_pose_search.interface import ModelPoseSearchInputs
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from cdff_core.dfns.model_registration.interface import ModelRegistrationInputs
from evaluation.scenes.spacecraft_images import photographs
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
    register = node("model_registration")
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
        pose = of_refinement.poses[0]
        of_registration = ModelRegistrationInputs(
            scan=scan,
            pose=pose,
            drawn_vertices=model.drawn_vertices,
            drawn_triangles=model.drawn_triangles,
            centre_m=model.centre_m,
            sigma_m=sensor.sigma_m,
            **surface,
        )
        report[name] = {
            "points": len(scan),
            "ModelRegistration": measure(partial(register.process, of_registration), rounds),
            "LidarTargetTracking": measure(tracking(body, scan, pose), rounds),
            "ModelPoseSearch": measure(partial(search.process, of_search), rounds),
            "ModelPoseRefinement": measure(partial(refine.process, of_refinement), rounds),
            "TargetDetection": measure(partial(lambda s: list(detection.step(s)), sample), rounds),
        }
    report["photograph"] = image_costs(data, model, rounds)
    return report


def image_costs(data: Path, model: Any, rounds: int) -> dict[str, Any]:
    """Return the costs of the DFNs that compare a photograph with renderings, in the first one that is not
    refused.
    """
    undistort, search = node("image_undistortion"), node("image_pose_search")
    refine = node("image_pose_refinement")
    body = {
        "vertices": model.drawn_vertices,
        "triangles": model.drawn_triangles,
        "centre_m": model.centre_m,
        "diameter_m": model.diameter_m,
    }
    for name, distorted, T in photographs(data):
        frame = undistort.process(ImageUndistortionInputs(image=distorted)).image
        image = {"image": frame.image, "camera_matrix": frame.camera_matrix}
        of_search = ImagePoseSearchInputs(**image, **body)
        try:
            search.process(of_search)  # renders the views of the body
        except RefusedError:
            continue
        of_refinement = ImagePoseRefinementInputs(
            **image, pose=T, covariance=np.diag(np.square([0.1, 0.1, 0.2, 0.03, 0.03, 0.03])), **body
        )
        return {
            "image": name,
            "triangles": len(model.drawn_triangles),
            "ImagePoseSearch": measure(partial(search.process, of_search), rounds),
            "ImagePoseRefinement": measure(partial(refine.process, of_refinement), rounds),
        }
    raise CdffError("every photograph has a bright background")


def tracking(body: Any, scan: Any, pose: Any) -> Callable[[], Any]:
    """Return a step of lidar_target_tracking with one scan of a body at rest per call, after a guess."""
    dfpc = Registry.default().make_dfpc("lidar_target_tracking")
    dfpc.configure()
    model = model_sample(body, "tango")
    guess = TransformWithCovariance.from_transform(
        UncertainTransform(pose), parent="lidar", child=model.value.frame, stamp_ns=0
    )
    list(dfpc.step(model))
    list(dfpc.step(Sample("guess", 0, 0, guess)))
    stamps_ns = itertools.count(0, 10**9)

    def step() -> None:
        stamp_ns = next(stamps_ns)
        value = Pointcloud.from_points(scan, frame="lidar", stamp_ns=stamp_ns)
        pose_output, _ = dfpc.step(Sample("cloud", stamp_ns, 0, value))
        assert pose_output.value is not None, pose_output.quality.reasons

    return step


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
