# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure far_range_tracking and its DFNs on images of 640 x 360 pixels with two moving bodies.

python benchmarks/distant_rovers.py [--rounds N]
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from _report import measure

from cdff_common.camera import CameraModel
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame
from cdff_core.dfns.appearance_tracking.interface import AppearanceTrackingInputs
from cdff_core.dfns.moving_region_detection.interface import MovingRegionDetectionInputs
from cdff_core.dfns.scene_registration.interface import SceneRegistrationInputs
from cdff_core.dfns.terrain_ray_intersection.interface import TerrainRayIntersectionInputs
from cdff_core.dfns.track_association.interface import TrackAssociationInputs

CAMERA = CameraModel(360, 640, 800.0, 800.0, 319.5, 179.5)
STAMP_NS = 1_700_000_000_000_000_000


def images(count: int) -> list[np.ndarray]:
    """Return images of textured ground with two bodies that move, and noise."""
    rng = np.random.default_rng(1)
    ground = cv2.GaussianBlur(
        rng.normal(0.0, 1.0, (CAMERA.rows, CAMERA.cols)).astype(np.float32), (0, 0), 2.0
    )
    ground = 110.0 + 12.0 * ground / ground.std()
    bodies = [rng.uniform(20.0, 230.0, (24, 28)), rng.uniform(20.0, 230.0, (18, 22))]
    result = []
    for k in range(count):
        image = ground.copy()
        for body, (u, v) in zip(bodies, ((60 + 3 * k, 140), (500 - 2 * k, 180)), strict=True):
            h, w = body.shape
            image[v : v + h, u : u + w] = body
        image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0.0, 1.5, image.shape)
        result.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return result


def main() -> int:
    """Print the report as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    report: dict[str, Any] = {}

    def record(name: str, call: Callable[[], Any]) -> None:
        report[name] = measure(call, arguments.rounds)

    frames = images(120)
    registry = Registry.default()

    def made(name: str, implementation: str) -> Any:
        dfn = registry.make_dfn(name, implementation)
        dfn.configure()
        return dfn

    registration = made("SceneRegistration", "SparseFlow")
    moved_image = np.roll(frames[0], 2, axis=1)
    inputs = SceneRegistrationInputs(previous=frames[0], current=moved_image)
    record("SceneRegistration", lambda: registration.process(inputs))

    detection, index = made("MovingRegionDetection", "RegisteredBackground"), itertools.count()
    places = np.stack(np.meshgrid(np.arange(CAMERA.cols), np.arange(CAMERA.rows)), axis=-1).astype(np.float32)

    def detect() -> Any:
        k = next(index) % len(frames)
        searched_places = None if k == 0 else places
        return detection.process(
            MovingRegionDetectionInputs(image=frames[k], places=searched_places, is_at_rest=k % 2 == 0)
        )

    detect()
    record("MovingRegionDetection", detect)

    tracking = made("AppearanceTracking", "MaskedCorrelation")
    template = frames[0][140:164, 62:86].astype(np.float32)
    match = AppearanceTrackingInputs(
        image=frames[1],
        template=template,
        weights=np.ones_like(template),
        place=np.array([75.0, 152.0]),
        reach=np.array([12.0, 12.0]),
        scales=np.array([1.0, 0.95, 1.05]),
        noise=1.5,
    )
    record("AppearanceTracking", lambda: tracking.process(match))

    association, rng = made("TrackAssociation", "JointAssignment"), np.random.default_rng(2)
    m, n = 10, 20
    pairs = TrackAssociationInputs(
        places=rng.uniform(0.0, 100.0, (m, 2)),
        covariances=np.repeat(4.0 * np.eye(2)[None], m, axis=0),
        sizes=np.full((m, 2), 20.0),
        size_sigmas=np.full(m, 0.2),
        regions=rng.uniform(0.0, 100.0, (n, 2)),
        region_covariances=np.repeat(0.1 * np.eye(2)[None], n, axis=0),
        region_sizes=np.full((n, 2), 20.0),
    )
    record("TrackAssociation", lambda: association.process(pairs))

    terrain = made("TerrainRayIntersection", "HeightGridMarch")
    azimuth = np.linspace(0.0, 1.0, 10)
    directions = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.full(10, -0.04)])
    lines = TerrainRayIntersectionInputs(
        heights=np.zeros((1200, 1200)),
        corner=np.array([-60.0, 60.0]),
        resolution=0.1,
        origin=np.array([0.0, 0.0, 2.0]),
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        elevation_sigmas=np.full(10, 4e-4),
    )
    record("TerrainRayIntersection", lambda: terrain.process(lines))

    dfpc = registry.make_dfpc("far_range_tracking")
    dfpc.configure({"target_height_m": 1.4})
    stamps = itertools.count()

    def step() -> Any:
        k = next(stamps)
        stamp_ns = STAMP_NS + k * 500_000_000
        frame = Frame.from_image(
            frames[k % len(frames)], stamp_ns=stamp_ns, sensor="robot/camera", camera_matrix=CAMERA.matrix
        )
        return list(dfpc.step(Sample("image", stamp_ns, k, frame, frame="robot/camera")))

    for _ in range(12):
        step()
    record("FarRangeTracking", step)
    sys.stdout.write(json.dumps(report, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
