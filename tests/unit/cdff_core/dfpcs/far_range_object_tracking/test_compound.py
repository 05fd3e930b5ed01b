# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, ObjectTrackStatusT, RigidBodyState
from cdff_core.dfpcs.far_range_object_tracking.target_ranging import TargetRange
from cdff_core.runtime.runner import Runner
from tests.support.star_scene import CAMERA, T0_NS, StarScene

CONFIRMED, COASTING = ObjectTrackStatusT.TRACK_CONFIRMED, ObjectTrackStatusT.TRACK_COASTING
#: Rate of the object, inertial axes, rad/s: 1.3 pixels per image.
RATE = np.array([2e-4, 4e-4, -1e-4])


def compound(**config: object):
    dfpc = Registry.default().make_dfpc("far_range_object_tracking")
    dfpc.configure(config, DfpcContext("robot"))
    return dfpc


def direction(scene: StarScene, time_s: float) -> np.ndarray:
    start = scene.attitude @ np.array([0.01, -0.02, 1.0])
    return np.asarray(se3.exp_so3(RATE * time_s) @ start / np.linalg.norm(start))


def images(
    scene: StarScene, count: int, snr: float = 8.0, dark: range = range(0), first: int = 0
) -> Iterator[tuple[Sample, np.ndarray]]:
    for k in range(first, first + count):
        light, pixel = scene.light(k), scene.pixel(direction(scene, k), k)
        if k not in dark:
            scene.add_point(light, pixel, snr)
        yield scene.sample(light, k), pixel


def tracks(outputs: list[Output]) -> list[Output]:
    return [o for o in outputs if o.port == "track" and o.value.metadata.status in (CONFIRMED, COASTING)]


def test_an_object_among_stars_is_followed_in_inertial_directions_without_a_given_attitude() -> None:
    scene, dfpc = StarScene(), compound()
    squares = []
    for k, (sample, pixel) in enumerate(images(scene, 25)):
        outputs = list(dfpc.step(sample))
        track_outputs = tracks(outputs)
        if k < 6:
            continue
        assert [o.value.metadata.track_id for o in track_outputs] == [1]
        track = track_outputs[0].value
        assert np.linalg.norm(track.data.pixels[0] - pixel) < 1.0
        assert track.metadata.frame_id == "inertial"
        azimuth, elevation, sigma_a, sigma_e, range_m, _ = track.data.bearings[0]
        u = direction(scene, k)
        error = np.array(
            [
                ((azimuth - np.arctan2(u[1], u[0]) + np.pi) % (2 * np.pi) - np.pi) * np.cos(elevation),
                elevation - np.arcsin(u[2]),
            ]
        )
        squares.append(((error / [sigma_a, sigma_e]) ** 2).sum())
        assert np.isnan(range_m)
        assert np.isnan(track.data.poses[0, :3]).all()
        assert "range_unobservable" in track_outputs[0].quality.reasons
    assert np.mean(squares) < 5.0
    attitude = next(o for o in outputs if o.port == "attitude_estimate")
    error_rad = se3.rotation_angle(attitude.value.transform.matrix[:3, :3] @ scene.rotation(24).T)
    assert (
        error_rad < 4.0 * np.sqrt(np.linalg.eigvalsh(attitude.value.transform.covariance[3:, 3:])[-1]) + 2e-5
    )


def test_the_eclipse_is_passed_by_coasting_with_growing_covariance_and_the_same_number() -> None:
    scene, dfpc = StarScene(seed=2, rate=np.zeros(3)), compound()
    sigmas, statuses = [], []
    for sample, _ in images(scene, 40, dark=range(15, 30)):
        track_outputs = tracks(list(dfpc.step(sample)))
        statuses.append(
            [(o.value.metadata.track_id, o.value.metadata.status, o.quality.status) for o in track_outputs]
        )
        sigmas += [
            o.value.data.bearings[0, 2]
            for o in track_outputs
            if 15 <= o.value.data.stamps[0] * 1000 - T0_NS < 30e9
        ]
    for k in range(16, 30):
        assert statuses[k] == [(1, COASTING, Status.DEGRADED)]
    assert statuses[-1] == [(1, CONFIRMED, Status.OK)]
    coasting = sigmas[16:30]
    assert all(later > earlier for earlier, later in pairwise(coasting))


def test_an_empty_sky_gives_no_object_and_says_that_the_attitude_is_missing() -> None:
    scene, dfpc = StarScene(seed=3), compound()
    for k in range(12):
        outputs = list(dfpc.step(scene.sample(np.zeros((CAMERA.rows, CAMERA.cols), np.float32), k)))
        assert not tracks(outputs)
        quality = next(o for o in outputs if o.port == "detections").quality
        assert quality.status is Status.DEGRADED
        assert "attitude_missing" in quality.reasons


def test_without_stars_the_directions_are_inertial_only_with_a_given_attitude() -> None:
    for has_attitude in (False, True):
        scene, dfpc = StarScene(seed=4), compound(use_stars=has_attitude)
        for k in range(14):
            light = np.zeros((CAMERA.rows, CAMERA.cols), np.float32)
            scene.add_point(light, scene.pixel(direction(scene, k), k), 9.0)
            if has_attitude:
                dfpc.step(scene.attitude_sample(k))
            outputs = list(dfpc.step(scene.sample(light, k)))
        track_outputs = tracks(outputs)
        assert [o.frame for o in track_outputs] == ["inertial" if has_attitude else "robot/camera"]
        assert ("attitude_missing" in track_outputs[0].quality.reasons) is not has_attitude


def test_a_hot_pixel_a_cosmic_ray_and_a_smeared_image_give_no_false_object() -> None:
    scene, dfpc = StarScene(seed=5), compound()
    for k in range(30):
        light = scene.light(k)
        light[100, 200] += 400.0
        light[300, 50] += 90.0
        row, col = scene.rng.integers(20, 360, 2)
        for step in range(6):
            light[row + step // 2, col + step] += 800.0
        if 12 <= k < 15:
            kernel = np.zeros((1, 15), np.float32) + 1.0 / 15.0
            light = cv2.filter2D(light, -1, kernel)
        outputs = list(dfpc.step(scene.sample(light, k)))
        assert not tracks(outputs)


def test_a_saturated_image_is_refused_at_first_and_coasted_over_later() -> None:
    scene, dfpc = StarScene(seed=6), compound()
    white = np.full((CAMERA.rows, CAMERA.cols), 1e6, np.float32)
    (first,) = dfpc.step(scene.sample(white, 0))
    assert first.value is None
    assert first.quality.status is Status.FAILED
    assert first.quality.reasons[0].startswith("saturated")
    for sample, _ in images(scene, 12, first=1):
        outputs = list(dfpc.step(sample))
    assert tracks(outputs)[0].value.metadata.status is CONFIRMED
    outputs = list(dfpc.step(scene.sample(white, 13)))
    assert tracks(outputs)[0].value.metadata.status is COASTING
    assert any(reason.startswith("saturated") for reason in tracks(outputs)[0].quality.reasons)


@pytest.mark.slow
def test_a_wrong_focal_length_and_a_wrong_attitude_are_reported_and_give_no_inertial_direction() -> None:
    scene = StarScene(seed=7)
    wrong = CameraModel(CAMERA.rows, CAMERA.cols, 3200.0, 3200.0, CAMERA.cx, CAMERA.cy)
    dfpc = compound()
    for k in range(3):
        frame = Frame.from_image(
            scene.sample(scene.light(k), k).value.image,
            stamp_ns=T0_NS + k * 10**9,
            sensor="robot/camera",
            camera_matrix=wrong.matrix,
        )
        dfpc.step(scene.attitude_sample(k))
        outputs = list(dfpc.step(Sample("image", T0_NS + k * 10**9, k, frame, frame="robot/camera")))
    quality = next(o for o in outputs if o.port == "detections").quality
    assert quality.status is Status.DEGRADED
    assert {"not_identified", "attitude_or_camera_wrong"} & set(quality.reasons)
    dfpc = compound()
    dfpc.step(scene.attitude_sample(3, error_rad=0.2))
    outputs = list(dfpc.step(scene.sample(scene.light(3), 3)))
    reasons = next(o for o in outputs if o.port == "attitude_estimate").quality.reasons
    assert any(reason.startswith("attitude_differs_from_stars:11.4") for reason in reasons)


@pytest.mark.parametrize("has_covariance", [True, False])
def test_with_the_state_in_orbit_the_direction_is_also_given_in_the_axes_of_the_orbit(
    has_covariance: bool,
) -> None:
    scene, dfpc = StarScene(), compound(observer="sun", use_stars=False)
    # The servicer flies towards the object: its velocity has the direction of the object.
    ahead = direction(scene, 11)
    up = np.cross(ahead, [0.0, 0.0, 1.0])
    up /= np.linalg.norm(up)
    state = RigidBodyState(
        target_frame="inertial", source_frame="robot/base", pos=7.0e6 * up, velocity=7500.0 * ahead
    )
    if has_covariance:
        state = replace(state, cov_position=25.0 * np.eye(3), cov_velocity=0.0025 * np.eye(3))
    list(dfpc.step(Sample("navigation", T0_NS + 11 * 10**9, 0, state, frame="inertial")))
    for k, (sample, _) in enumerate(images(scene, 12)):
        list(dfpc.step(scene.attitude_sample(k)))
        outputs = list(dfpc.step(sample))
    inertial = next(o for o in outputs if o.port == "track")
    output = next(o for o in outputs if o.port == "track_lvlh")
    assert (output.frame, output.value.metadata.frame_id) == ("robot/lvlh", "robot/lvlh")
    assert output.value.metadata.track_id == inertial.value.metadata.track_id
    azimuth, elevation, sigma_a, sigma_e, range_m, _ = output.value.data.bearings[0]
    assert np.hypot(azimuth, elevation) < 5.0 * np.hypot(sigma_a, sigma_e) + 1e-4
    assert np.isnan(range_m)
    # The angular velocity is relative to the axes, which turn by 1.07 mrad/s.
    assert np.linalg.norm(output.value.velocities[0, 3:]) > 5e-4
    # The error of the state turns the axes by 7e-6 rad.
    assert max(sigma_a, sigma_e) == pytest.approx(inertial.value.data.bearings[0, 2:4].max(), rel=0.05)
    assert ("navigation_covariance_unknown" in output.quality.reasons) is not has_covariance
    assert set(inertial.quality.reasons) <= set(output.quality.reasons)


def test_an_image_without_camera_and_time_going_backwards_are_refused() -> None:
    scene, dfpc = StarScene(seed=8), compound()
    frame = Frame.from_image(np.zeros((384, 512), np.uint16), stamp_ns=T0_NS)
    with pytest.raises(InputError, match="expected a pinhole, fisheye"):
        dfpc.step(Sample("image", T0_NS, 0, frame))
    for sample, _ in images(scene, 3, first=5):
        dfpc.step(sample)
    earlier = scene.sample(scene.light(2), 2)
    with pytest.raises(InputError, match="expected later than the previous one"):
        dfpc.step(earlier)
    runner = Runner(compound())
    for sample, _ in images(scene, 3, first=5):
        runner.push(sample)
        list(runner.drain())
    assert runner.push(earlier) is False
    assert runner.counters.late == 1


def test_the_motion_of_an_object_can_be_asked_for() -> None:
    scene, dfpc = StarScene(seed=9), compound()
    for sample, _ in images(scene, 20):
        dfpc.step(sample)
    later = dfpc.call("predict", {"id": "1", "t_ns": str(T0_NS + 30 * 10**9)})
    azimuth, elevation = later.data.bearings[0, :2]
    u = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    assert np.linalg.norm(u - direction(scene, 30)) < 5.0 * later.data.bearings[0, 2:4].max()
    assert dfpc.store.get("tracks").metadata.track_id == 1
    with pytest.raises(ProductNotFoundError, match=r"object 7: expected one of \[1\]"):
        dfpc.call("predict", {"id": "7"})


@pytest.mark.parametrize(("reasons", "status"), [((), Status.OK), (("range_interval",), Status.DEGRADED)])
def test_the_position_of_a_resolved_target_has_the_time_and_the_frames_of_its_image(
    reasons: tuple[str, ...], status: Status
) -> None:
    T = UncertainTransform(se3.transform(np.eye(3), [0.0, 0.0, 10.0]), np.eye(6))
    ranging = TargetRange(10.0, 0.1, np.array([9.0, 11.0]), T, "client", reasons, 2.0, ("model",))
    scene = StarScene()
    output = compound()._position_output(scene.sample(scene.light(3), 3), ranging)
    assert (output.t0_ns, output.t1_ns) == (T0_NS + 3 * 10**9,) * 2
    assert (output.frame, output.child, output.inputs) == ("robot/camera", "client/body", ("image3", "model"))
    assert (output.quality.status, output.quality.reasons) == (status, reasons)
    assert output.quality.metrics["range_relative_sigma"] == pytest.approx(0.01)
    np.testing.assert_array_equal(output.value.transform.matrix, T.matrix)


def test_two_runs_give_the_same_tracks() -> None:
    results = []
    for _ in range(2):
        scene, dfpc = StarScene(seed=10), compound()
        values = [o.value for sample, _ in images(scene, 10) for o in dfpc.step(sample)]
        results.append(values)
    assert results[0] == results[1]
