# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelTracking: detection at the start and after a loss, hidden objects, delayed depths, real images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Mesh
from tests.support import satellite
from tests.support.depth_scenes import T_CAMERA_TABLE, depth_image

PREPARE = {"points": 3000, "views": 60, "view_pixels": 96, "grid_cells": 32}
BRACKET = satellite.merged(
    satellite.box((0.20, 0.12, 0.06), (0.0, 0.0, 0.03)),
    satellite.box((0.05, 0.12, 0.12), (-0.075, 0.0, 0.12)),
)


def truth(k: int) -> np.ndarray:
    """Return T_camera_body at the k-th image; ten images per second."""
    R = se3.exp_so3([0.0, 0.0, 0.5 + 0.05 * k])
    return T_CAMERA_TABLE @ se3.transform(R, np.array([-0.1 + 0.01 * k, 0.0, 0.0]))


def make_dfpc() -> Dfpc:
    dfpc = Registry.default().make_dfpc("model_tracking")
    dfpc.configure({"prepare": PREPARE})
    value = Mesh.from_arrays(*BRACKET, frame="bracket/body", stamp_ns=0)
    assert list(dfpc.step(Sample("model", 0, 0, value, id="m"))) == []
    return dfpc


def depth(k: int, rng: np.random.Generator, T: np.ndarray | None = None) -> Sample:
    stamp_ns = 100_000_000 * k
    image = depth_image([(BRACKET, truth(k) if T is None else T)], rng, stamp_ns=stamp_ns)
    return Sample("depth", stamp_ns, k, image, id=f"d{k}", frame="rover/depth")


def poses_of(dfpc: Dfpc, samples: list[Sample]) -> dict[int, Output]:
    """Return the output with the pose of each image, by the number of the image."""
    outputs = [output for sample in samples for output in dfpc.step(sample)] + list(dfpc.finish())
    return {round(output.t1_ns / 1e8): output for output in outputs if output.port == "pose"}


def errors(pose: Output, T: np.ndarray) -> tuple[float, float]:
    estimate = pose.value.transform.matrix
    angle = se3.rotation_angle(estimate[:3, :3].T @ T[:3, :3])
    return float(np.linalg.norm(estimate[:3, 3] - T[:3, 3])), float(np.degrees(angle))


def test_an_object_is_detected_and_tracked(rng: np.random.Generator) -> None:
    poses = poses_of(make_dfpc(), [depth(k, rng) for k in range(6)])
    assert poses[0].quality.reasons == ("new_track",)
    for k in range(6):
        metres, degrees = errors(poses[k], truth(k))
        assert metres < 0.005
        assert degrees < 1.5
    assert all(poses[k].quality.status is Status.OK for k in range(1, 6))


def test_a_lost_object_is_detected_where_it_is_now(rng: np.random.Generator) -> None:
    elsewhere = T_CAMERA_TABLE @ se3.transform(se3.exp_so3([0.0, 0.0, -2.0]), np.array([0.25, 0.05, 0.0]))
    samples = [depth(k, rng) for k in range(3)]
    samples += [depth(k, rng, T=elsewhere) for k in range(3, 8)]
    poses = poses_of(make_dfpc(), samples)
    assert "coasting" in poses[3].quality.reasons
    metres, degrees = errors(poses[7], elsewhere)
    assert metres < 0.005
    assert degrees < 1.5
    assert any("new_track" in pose.quality.reasons for k, pose in poses.items() if k > 3)


def test_an_absent_object_is_not_tracked(rng: np.random.Generator) -> None:
    other = satellite.box((0.16, 0.10, 0.08), (0.0, 0.0, 0.04))
    samples = [
        Sample("depth", 100_000_000 * k, k, depth_image([(other, truth(0))], rng), frame="rover/depth")
        for k in range(3)
    ]
    poses = poses_of(make_dfpc(), samples)
    assert all(pose.quality.status is Status.FAILED for pose in poses.values())
    assert "not_found" in poses[0].quality.reasons
    assert "waiting_for_detection" in poses[1].quality.reasons


def test_an_empty_depth_image_is_coasted(rng: np.random.Generator) -> None:
    samples = [depth(k, rng) for k in range(3)]
    empty = DistanceImage(width=320, height=240, scale_x=0.0025, scale_y=0.0025, data=np.zeros(320 * 240))
    samples.append(Sample("depth", 300_000_000, 3, empty, frame="rover/depth"))
    samples.append(depth(4, rng))
    poses = poses_of(make_dfpc(), samples)
    assert poses[3].quality.reasons == ("coasting", "few_depths:0<30")
    assert poses[4].quality.status is Status.OK


@pytest.mark.slow
def test_the_dragon_of_visp_is_tracked_without_a_guess(real_data: Callable[[str], Path]) -> None:
    from evaluation import model_tracking as evaluated
    from evaluation.data_sets.rgbd_objects import TrackedObjects

    objects = TrackedObjects(real_data(evaluated.FOLDER))
    objects.__dict__["frames"] = objects.frames[:10]
    rows = evaluated.track(objects, "dragon")
    assert np.median([row["mm"] for row in rows]) < 8.0
    assert np.median([row["deg"] for row in rows]) < 2.0
    assert max(row["mm"] for row in rows) < 20.0
