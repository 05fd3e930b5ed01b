# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""VisualTargetTracking: a rotating satellite, dark images, loss, wrong input, ViSP's castle."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Frame, Mesh, Time, TransformWithCovariance, Vector3d
from cdff_core.object_models.rendering import Window, render
from cdff_core.object_models.shading_fit import ShadingFit
from cdff_core.object_models.tracked_state import TrackedState
from tests.support import coloured_boxes, satellite
from tests.support.satellite_images import CAMERA_MATRIX, image_of
from tests.support.sunlit_images import sunlit

PREPARE = {"points": 4000, "views": 60, "view_pixels": 96, "grid_cells": 32}
BODY = satellite.merged(satellite.box((1.0, 0.8, 0.6)), satellite.box((0.3, 0.3, 0.5), (0.2, 0.1, 0.5)))
RATE = np.radians([6.0, 4.0, -3.0])


def truth(t_s: float) -> np.ndarray:
    """Return T_camera_body at a time."""
    R = se3.exp_so3([0.4, -0.8, 0.3]) @ se3.exp_so3(t_s * RATE)
    return se3.transform(R, np.array([0.05, 0.0, 4.0]) + t_s * np.array([0.02, 0.0, -0.01]))


def image(t_s: float, pixels: np.ndarray, distortion: tuple[float, ...] = ()) -> Sample:
    stamp_ns = round(1e9 * t_s)
    value = Frame.from_image(
        pixels, sensor="camera", stamp_ns=stamp_ns, camera_matrix=CAMERA_MATRIX, dist_coeffs=distortion
    )
    return Sample("image", stamp_ns, 0, value, id=f"i{stamp_ns}")


def model(mesh: satellite.Mesh = BODY) -> Sample:
    value = Mesh.from_arrays(*mesh, frame="client/body", stamp_ns=0)
    return Sample("model", 0, 0, value, id="m")


def guess(T: np.ndarray) -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="camera", child="client/body", stamp_ns=0
    )
    return Sample("guess", 0, 0, value)


def make_dfpc(T_guess: np.ndarray | None = None, **config: float) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure({"prepare": PREPARE, **config})
    assert list(dfpc.step(model())) == []
    if T_guess is not None:
        assert list(dfpc.step(guess(T_guess))) == []
    return dfpc


def step(dfpc: Dfpc, sample: Sample) -> tuple[Output, Output]:
    pose, track = dfpc.step(sample)
    assert (pose.port, track.port) == ("pose", "track")
    assert pose.quality == track.quality
    return pose, track


def errors(pose: Output, t_s: float) -> tuple[float, float]:
    error = pose_error(truth(t_s), pose.value.transform.matrix)
    return float(np.degrees(np.linalg.norm(error[3:]))), float(np.linalg.norm(error[:3]))


def tracked(rng: np.random.Generator, count: int, **config: float) -> Dfpc:
    """Return a tracker after ``count`` images, two per second."""
    dfpc = make_dfpc(truth(0.0), **config)
    for k in range(count):
        step(dfpc, image(0.5 * k, image_of(BODY, truth(0.5 * k), rng)))
    return dfpc


@pytest.mark.slow
def test_an_image_without_agreeing_edges_corrects_the_pose_by_the_orientation_of_all_edges(
    rng: np.random.Generator,
) -> None:
    T = truth(0.0)
    start = se3.transform(se3.exp_so3([0.0, 0.0, 0.04]) @ T[:3, :3], T[:3, 3] + [0.03, -0.03, 0.0])
    dfpc = make_dfpc(start, min_agreement=1.0)
    pose, _ = step(dfpc, image(0.0, image_of(BODY, T, rng)))
    assert pose.quality.status is Status.DEGRADED
    assert "edge_orientation" in pose.quality.reasons
    assert "coasting" not in pose.quality.reasons
    assert any(reason.startswith("low_agreement:") for reason in pose.quality.reasons)
    error = pose_error(T, pose.value.transform.matrix)
    assert np.linalg.norm(error[:2]) < 0.01
    assert abs(error[5]) < 0.01
    assert error @ np.linalg.solve(pose.value.transform.covariance, error) < 30.0
    assert pose.quality.metrics["edge_correlation"] > 0.4
    within_interval, _ = step(dfpc, image(0.5, image_of(BODY, truth(0.5), rng)))
    assert "coasting" in within_interval.quality.reasons
    list(dfpc.step(guess(truth(0.6))))
    after_guess, _ = step(dfpc, image(0.6, image_of(BODY, truth(0.6), rng)))
    assert "edge_orientation" in after_guess.quality.reasons
    after_interval, _ = step(dfpc, image(1.6, image_of(BODY, truth(1.6), rng)))
    assert "edge_orientation" in after_interval.quality.reasons
    assert errors(after_interval, 1.6)[0] < 5.0


def test_a_rotating_body_is_tracked_from_a_guess_that_is_off(rng: np.random.Generator) -> None:
    T = truth(0.0)
    off = se3.transform(se3.exp_so3([0.02, -0.02, 0.01]) @ T[:3, :3], T[:3, 3] + [0.02, -0.01, 0.03])
    dfpc, all_errors = make_dfpc(off), []
    for k in range(10):
        pose, state = step(dfpc, image(0.5 * k, image_of(BODY, truth(0.5 * k), rng)))
        assert pose.quality.status is (Status.DEGRADED if k == 0 else Status.OK), pose.quality.reasons
        all_errors.append(errors(pose, 0.5 * k))
    assert np.max(all_errors[1:], axis=0)[0] < 1.0
    assert np.max(all_errors[1:], axis=0)[1] < 0.02
    R = truth(4.5)[:3, :3]
    np.testing.assert_allclose(state.value.velocities[0, 3:], R @ RATE, atol=0.02)
    assert pose.value.child_frame == "client/body"
    assert {"agreement", "points", "innovation", "sigma_px"} <= set(pose.quality.metrics)


def test_dark_images_are_coasted_and_the_track_continues(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 8)
    sigmas = []
    for t_s in (4.0, 4.5):
        pose, _ = step(dfpc, image(t_s, np.full((240, 320), 10, np.uint8)))
        assert pose.quality.status is Status.DEGRADED
        assert "coasting" in pose.quality.reasons
        sigmas.append(np.trace(pose.value.transform.covariance))
    assert sigmas[1] > sigmas[0]
    pose, _ = step(dfpc, image(5.0, image_of(BODY, truth(5.0), rng)))
    assert pose.quality.status is Status.OK, pose.quality.reasons
    assert errors(pose, 5.0)[0] < 1.0


def test_another_body_is_not_used(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 4)
    other = image_of(satellite.cylinder(0.5, 0.7), truth(2.0), rng)
    pose, _ = step(dfpc, image(2.0, other))
    assert pose.quality.status is Status.DEGRADED
    assert "coasting" in pose.quality.reasons


def test_a_track_without_images_is_lost(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 2, lost_after_s=1.0)
    pose, track = step(dfpc, image(4.0, np.zeros((240, 320), np.uint8)))
    assert pose.quality.status is Status.FAILED
    assert "lost:3.5s" in pose.quality.reasons
    assert track.value is None


def test_missing_input_is_named(rng: np.random.Generator) -> None:
    dark = np.zeros((240, 320), np.uint8)
    pose, _ = step(make_dfpc(), image(0.0, dark))
    assert pose.quality.reasons == ("no_guess",)
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure()
    pose, _ = step(dfpc, image(0.0, dark))
    assert pose.quality.reasons == ("no_model",)


def test_a_repeated_stamp_keeps_the_state(rng: np.random.Generator) -> None:
    dfpc = tracked(rng, 2)
    before = dfpc.store.get("last_track").velocities
    pose, _ = step(dfpc, image(0.5, image_of(BODY, truth(0.5), rng)))
    assert pose.quality.status is Status.FAILED
    assert pose.quality.reasons == ("repeated_stamp",)
    np.testing.assert_array_equal(dfpc.store.get("last_track").velocities, before)


def test_lens_distortion_is_refused(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(truth(0.0))
    with pytest.raises(InputError, match="lens distortion"):
        dfpc.step(image(0.0, image_of(BODY, truth(0.0), rng), distortion=(0.1, 0.0, 0.0, 0.0)))


def depth(t_s: float, offset_m: float = 0.0) -> Sample:
    """Return a depth image of a camera that is ``offset_m`` to the right of that of the images."""
    T = truth(t_s)
    T[0, 3] -= offset_m
    K, stamp_ns = CAMERA_MATRIX, round(1e9 * t_s)
    rendered = render(*BODY, T, Window(K[0, 0], K[1, 1], K[0, 2], K[1, 2], 240, 320))
    value = DistanceImage(
        ref_time=Time.from_ns(stamp_ns),
        width=320,
        height=240,
        scale_x=1.0 / K[0, 0],
        scale_y=1.0 / K[1, 1],
        center_x=-K[0, 2] / K[0, 0],
        center_y=-K[1, 2] / K[1, 1],
        data=np.where(np.isfinite(rendered.depth_m), rendered.depth_m, 0.0).ravel(),
    )
    return Sample("depth", stamp_ns, 0, value, id=f"d{stamp_ns}", frame="camera")


def test_depths_of_a_camera_next_to_it_replace_dark_images(rng: np.random.Generator) -> None:
    dfpc = make_dfpc(truth(0.0), depth_offset_m=(0.1, 0.0, 0.0))
    for k in range(4):
        t_s = 0.5 * k
        assert list(dfpc.step(depth(t_s, 0.1))) == []
        shown = image_of(BODY, truth(t_s), rng) if k < 2 else np.full((240, 320), 10, np.uint8)
        pose, _ = step(dfpc, image(t_s, shown))
        assert "coasting" not in pose.quality.reasons
        assert errors(pose, t_s)[0] < 0.5
        assert errors(pose, t_s)[1] < 0.01
        assert pose.quality.status is (Status.DEGRADED if k == 0 else Status.OK)


def test_depth_images_alone_are_tracked() -> None:
    dfpc = make_dfpc(truth(0.0))
    outputs = [output for k in range(4) for output in dfpc.step(depth(0.5 * k))]
    poses = [output for output in outputs if output.port == "pose"]
    assert [pose.t1_ns for pose in poses] == [0, 500_000_000, 1_000_000_000, 1_500_000_000]
    assert errors(poses[-1], 1.5)[0] < 0.5
    assert errors(poses[-1], 1.5)[1] < 0.01
    assert poses[-1].frame == "camera"


def test_depths_in_front_of_the_body_hide_it() -> None:
    dfpc = make_dfpc(truth(0.0))
    for k in range(3):
        list(dfpc.step(depth(0.5 * k)))
    hidden = depth(1.5)
    part = hidden.value.data.reshape(240, 320)
    screen = dataclasses.replace(hidden.value, data=np.where(np.arange(320) < 160, 3.25, part).ravel())
    (pose, _) = dfpc.step(dataclasses.replace(hidden, value=screen))
    assert "coasting" not in pose.quality.reasons
    assert 0.05 < pose.quality.metrics["hidden"] < 0.7
    assert errors(pose, 1.5)[0] < 0.5
    screen = dataclasses.replace(hidden.value, data=np.full(240 * 320, 3.4))
    (pose, _) = dfpc.step(Sample("depth", 2_000_000_000, 0, screen))
    assert pose.quality.reasons[0] == "coasting"


def test_the_castle_of_visp_is_tracked(real_data: Callable[[str], Path]) -> None:
    from evaluation import visual_target_tracking as evaluated

    folder = real_data(evaluated.FOLDER)
    data, poses = folder.parent, evaluated.truth(folder.parent)[:6]
    images = evaluated.grey_images(data)[:6]
    rows = evaluated.track(
        data, poses, images, evaluated.guess_near(poses[0], 1), config={"prepare": PREPARE}
    )
    assert max(row["mm"] for row in rows) < 4.0
    assert max(row["deg"] for row in rows) < 1.2
    assert sum(row["is_degraded"] for row in rows) == 1


def after_three_colour_images(
    rng: np.random.Generator, change: Callable[[np.ndarray], np.ndarray], **config: bool
) -> Output:
    """Return the pose of a changed image of a coloured box that rests, after three images of it."""
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure({"prepare": PREPARE, "texture": False, **config})
    box = Mesh.from_arrays(*coloured_boxes.BOX, frame="client/body", stamp_ns=0)
    list(dfpc.step(Sample("model", 0, 0, box)))
    list(dfpc.step(guess(coloured_boxes.T_BOX)))
    for k in range(4):
        pixels = coloured_boxes.colour_image(coloured_boxes.T_BOX, rng, noise=5.0)
        stamp_ns = k * 200_000_000
        frame = Frame.from_image(
            pixels if k < 3 else change(pixels),
            sensor="camera",
            stamp_ns=stamp_ns,
            mode="RGB",
            camera_matrix=CAMERA_MATRIX,
        )
        pose, _ = step(dfpc, Sample("image", stamp_ns, k, frame))
    return pose


def test_colours_that_are_not_used_are_stated(rng: np.random.Generator) -> None:
    used = after_three_colour_images(rng, lambda pixels: pixels)
    assert (used.quality.status, used.quality.reasons) == (Status.OK, ())
    inverted = after_three_colour_images(rng, lambda pixels: 255 - pixels)
    assert inverted.quality.reasons == ("region_few_lines:0<20",)
    assert inverted.quality.status is Status.DEGRADED
    shifted = after_three_colour_images(rng, lambda pixels: np.roll(pixels, 8, axis=1))
    region, edges, orientation = shifted.quality.reasons
    assert region.startswith("region_low_agreement:0.")
    assert edges.startswith("low_agreement:0.")
    assert orientation == "edge_orientation"
    grey = after_three_colour_images(rng, lambda pixels: np.full_like(pixels, 128))
    assert grey.quality.reasons == ("coasting", "region_few_lines:0<20", "few_edges:0<6")
    without = after_three_colour_images(rng, lambda pixels: 255 - pixels, colour=False)
    assert (without.quality.status, without.quality.reasons) == (Status.OK, ())


@pytest.mark.slow
def test_colours_track_a_body_whose_edges_are_lost_in_noise(rng: np.random.Generator) -> None:
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure({"prepare": PREPARE, "texture": False})
    box = Mesh.from_arrays(*coloured_boxes.BOX, frame="client/body", stamp_ns=0)
    list(dfpc.step(Sample("model", 0, 0, box)))
    list(dfpc.step(guess(coloured_boxes.T_BOX)))
    for k in range(6):
        T = coloured_boxes.T_BOX.copy()
        T[0, 3] += 0.02 * k
        pixels = coloured_boxes.colour_image(T, rng, noise=60.0)
        frame = Frame.from_image(
            pixels, sensor="camera", stamp_ns=k * 200_000_000, mode="RGB", camera_matrix=CAMERA_MATRIX
        )
        pose, _ = step(dfpc, Sample("image", k * 200_000_000, k, frame))
        assert "coasting" not in pose.quality.reasons
        assert abs(pose_error(T, pose.value.transform.matrix)[0]) < 0.015
    assert pose.quality.metrics["lines"] > 50


def boulder() -> satellite.Mesh:
    """Return an irregular body of about 1 m."""
    import open3d

    ball = open3d.geometry.TriangleMesh.create_sphere(0.5, resolution=30)
    vertices = np.asarray(ball.vertices)
    waves = np.sin(9.0 * vertices @ np.array([[1.0, 0.3, 0.2], [0.2, 1.0, 0.4], [0.5, 0.1, 1.0]]))
    return vertices * (1.0 + 0.08 * waves.sum(axis=1, keepdims=True)), np.asarray(ball.triangles, np.int64)


@pytest.mark.slow
def test_the_direction_of_the_sun_tracks_a_smooth_body_half_in_the_dark(rng: np.random.Generator) -> None:
    rock, sun, distance_m = boulder(), np.array([0.8, -0.3, -0.5]), 3.0
    sun /= np.linalg.norm(sun)
    dfpc = Registry.default().make_dfpc("visual_target_tracking")
    dfpc.configure({"prepare": PREPARE, "texture": False, "initial_rate_radps": (0.0, 0.0, 0.2)})
    list(dfpc.step(Sample("model", 0, 0, Mesh.from_arrays(*rock, frame="client/body", stamp_ns=0))))
    off = se3.transform(se3.exp_so3([0.02, -0.02, 0.01]), [0.01, -0.01, distance_m])
    list(dfpc.step(guess(off)))
    list(dfpc.step(Sample("sun", 0, 0, Vector3d(values=sun))))
    for k in range(6):
        t_s = 0.5 * k
        T = se3.transform(se3.exp_so3([0.0, 0.0, 0.2 * t_s]), [0.0, 0.0, distance_m])
        light = sunlit(rock, T, CAMERA_MATRIX, sun)
        pixels = np.clip(5.0 + 150.0 * light + rng.normal(0.0, 2.0, light.shape), 0, 255).astype(np.uint8)
        pose, _ = step(dfpc, image(t_s, pixels))
        error = pose_error(T, pose.value.transform.matrix)
    assert pose.quality.status is Status.OK, pose.quality.reasons
    assert np.degrees(np.linalg.norm(error[3:])) < 0.5
    assert np.linalg.norm(error[:2]) < 0.005
    assert pose.quality.metrics["correlation"] > 0.9


@pytest.mark.parametrize("direction", [[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]])
def test_a_direction_of_the_sun_that_is_none_is_refused(direction: list[float]) -> None:
    dfpc = make_dfpc(truth(0.0))
    with pytest.raises(InputError, match="expected a finite direction"):
        list(dfpc.step(Sample("sun", 0, 0, Vector3d(values=np.array(direction)))))


@pytest.mark.parametrize(
    ("agreement", "correlation", "distance", "reason"),
    [
        (0.4, 0.9, 0.0, "shading_low_agreement:0.40<0.5"),
        (0.9, 0.5, 0.0, "low_correlation:0.50<0.6"),
        (0.9, np.nan, 0.0, "low_correlation:nan<0.6"),
        (0.9, 0.9, 1e9, "shading_innovation:1e+09>"),
    ],
)
def test_the_reason_why_the_light_of_the_sun_is_not_used_is_stated(
    monkeypatch: pytest.MonkeyPatch,
    rng: np.random.Generator,
    agreement: float,
    correlation: float,
    distance: float,
    reason: str,
) -> None:
    def fit(model: object, predicted: TrackedState, *_: object) -> ShadingFit:
        return ShadingFit(predicted, distance, agreement, 30, correlation)

    dfpc = make_dfpc(truth(0.0))
    list(dfpc.step(Sample("sun", 0, 0, Vector3d(values=np.array([0.0, 0.0, -1.0])))))
    monkeypatch.setattr(dfpc._shading, "fit", fit)
    pose, _ = step(dfpc, image(0.0, image_of(BODY, truth(0.0), rng)))
    assert any(stated.startswith(reason) for stated in pose.quality.reasons), pose.quality.reasons
