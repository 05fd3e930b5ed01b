# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the cost of the DFNs and compounds that detect and track a known body in images of ViSP.

NUMBA_NUM_THREADS=1 python benchmarks/visual_tracking.py [--data DIR] [--rounds N] [--out FILE]
"""

from __future__ import annotations

import argparse
import itertools
import os
import platform
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _report import measure, write_report

from cdff_common.formats.meshes.read import read_mesh
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, Mesh, TransformWithCovariance
from cdff_core.dfns.lit_body_rendering.interface import LitBodyRenderingInputs
from cdff_core.dfns.measured_pose_refinement.interface import MeasuredPoseRefinementInputs
from cdff_core.dfns.model_edge_measurement.interface import ModelEdgeMeasurementInputs
from cdff_core.dfns.model_region_measurement.interface import ModelRegionMeasurementInputs
from cdff_core.dfns.region_colour_learning.interface import RegionColourLearningInputs
from evaluation.data_sets.rgbd_objects import TrackedObjects
from evaluation.visual_target_tracking import CAMERA_MATRIX, FOLDER, INTERVAL_NS, grey_images, truth

RANGE_PX = 12.0


def costs(data: Path, rounds: int) -> dict[str, Any]:
    """Return CPU seconds and memory of each DFN and of the compound, for one image of a body at rest."""
    image, pose = grey_images(data)[0], truth(data)[0]
    mesh = read_mesh(data / FOLDER / "models" / "chateau.wrl")
    edges = Registry.default().make_dfn("model_edge_measurement")
    refine = Registry.default().make_dfn("measured_pose_refinement")
    edges.configure()
    refine.configure()
    of_edges = ModelEdgeMeasurementInputs(
        image=image.astype(np.float32),
        camera_matrix=CAMERA_MATRIX,
        pose=pose,
        vertices=mesh.vertices,
        triangles=mesh.triangles,
        range_px=RANGE_PX,
    )
    edge_points = edges.process(of_edges)
    of_refinement = MeasuredPoseRefinementInputs(
        points=edge_points.points,
        pixels=edge_points.pixels,
        normals=edge_points.normals,
        offsets=edge_points.offsets,
        camera_matrix=CAMERA_MATRIX,
        pose=pose,
        limit_px=RANGE_PX,
        prior_covariance=1e-4 * np.eye(20),
    )
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure()
    model = Mesh.from_arrays(mesh.vertices, mesh.triangles, frame="castle/body", stamp_ns=0)
    guess = TransformWithCovariance.from_transform(
        UncertainTransform(pose), parent="camera", child="castle/body", stamp_ns=0
    )
    list(dfpc.step(Sample("model", 0, 0, model)))
    list(dfpc.step(Sample("guess", 0, 0, guess)))
    stamps_ns = itertools.count(0, INTERVAL_NS)

    def step() -> None:
        stamp_ns = next(stamps_ns)
        frame = Frame.from_image(image, sensor="camera", stamp_ns=stamp_ns, camera_matrix=CAMERA_MATRIX)
        output, _ = dfpc.step(Sample("image", stamp_ns, 0, frame))
        assert output.value is not None, output.quality.reasons

    return (
        _objects(data, rounds)
        | _regions(image, pose, mesh, rounds)
        | {
            "control_points": len(edge_points.points),
            "ModelEdgeMeasurement": measure(partial(edges.process, of_edges), rounds),
            "MeasuredPoseRefinement": measure(partial(refine.process, of_refinement), rounds),
            "VisualTargetTracking": measure(step, rounds),
        }
    )


def _regions(image: Any, pose: Any, mesh: Any, rounds: int) -> dict[str, Any]:
    """Return the costs of the DFNs of the regions of colour and of the light for one image."""
    learn = Registry.default().make_dfn("region_colour_learning")
    measure_regions = Registry.default().make_dfn("model_region_measurement")
    learn.configure()
    measure_regions.configure()
    ports = {
        "image": np.repeat(image[:, :, None], 3, axis=2),
        "camera_matrix": CAMERA_MATRIX,
        "pose": pose,
        "vertices": mesh.vertices,
        "triangles": mesh.triangles,
    }
    of_learning = RegionColourLearningInputs(**ports)
    colours = learn.process(of_learning)
    of_regions = ModelRegionMeasurementInputs(
        **ports,
        body_colours=colours.body_colours,
        background_colours=colours.background_colours,
        range_px=RANGE_PX,
    )
    light = Registry.default().make_dfn("lit_body_rendering")
    light.configure()
    of_light = LitBodyRenderingInputs(
        image=image,
        camera_matrix=CAMERA_MATRIX,
        pose=pose,
        vertices=mesh.vertices,
        triangles=mesh.triangles,
        sun=np.array([0.5, -0.5, -0.7]),
    )
    return {
        "LitBodyRendering": measure(partial(light.process, of_light), rounds),
        "RegionColourLearning": measure(partial(learn.process, of_learning), rounds),
        "ModelRegionMeasurement": measure(partial(measure_regions.process, of_regions), rounds),
    }


def _objects(data: Path, rounds: int) -> dict[str, Any]:
    """Return the costs of model_detection and model_tracking for an object at rest."""
    objects = TrackedObjects(data / "visp_rbt_rgbd")
    frame = objects.frames[0]
    detection, tracking = (Registry.default().make_dfpc(n) for n in ("model_detection", "model_tracking"))
    for dfpc in (detection, tracking):
        dfpc.configure()
        list(dfpc.step(objects.model("dragon")))
    depth, image = objects.depth(frame), objects.image(frame)
    stamps_ns = itertools.count(0, INTERVAL_NS)

    def detect() -> None:
        (output,) = detection.step(depth)
        assert output.value is not None, output.quality.reasons

    def track() -> None:
        stamp_ns = next(stamps_ns)
        samples = [replace(sample, stamp_ns=stamp_ns) for sample in (depth, image)]
        (output, *_) = [output for sample in samples for output in tracking.step(sample)]
        assert output.value is not None, output.quality.reasons

    track()
    return {
        "ModelDetection": measure(detect, max(rounds // 5, 1)),
        "ModelTracking": measure(track, rounds),
    }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default_data = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or default_data))
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {
        "benchmark": "visual_tracking",
        "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        **costs(args.data, args.rounds),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()
