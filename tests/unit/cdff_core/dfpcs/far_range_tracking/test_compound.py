# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdff_common.codecs import encode
from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import (
    ElevationMap,
    Frame,
    Mesh,
    ObjectDetection,
    ObjectDetections,
    ObjectTrackStatusT,
    TransformWithCovariance,
)
from cdff_core.runtime.runner import Runner
from dpm_store import NewProduct, Query, open_store
from tests.support.distant_scene import BASELINE_M, CAMERA, PERIOD_NS, T0_NS, Body, DistantScene

CONFIRMED, COASTING = ObjectTrackStatusT.TRACK_CONFIRMED, ObjectTrackStatusT.TRACK_COASTING
#: Camera axes (x right, y down, z forward) of a camera that looks along x, z up.
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def compound(**config: object):
    dfpc = Registry.default().make_dfpc("far_range_tracking")
    dfpc.configure(config, DfpcContext("robot"))
    return dfpc


def tracks(outputs: list[Output]) -> list[Output]:
    return [o for o in outputs if o.port == "track"]


def pose(
    k: int, T: np.ndarray, parent: str = "site", sigma_m: float = 0.01, child: str = "robot/camera"
) -> Sample:
    covariance = np.diag([sigma_m**2] * 3 + [1e-8] * 3)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance), parent=parent, child=child, stamp_ns=T0_NS + k * PERIOD_NS
    )
    return Sample("pose", T0_NS + k * PERIOD_NS, k, value, id=f"t{k}", frame=parent, child=child)


def run(dfpc, scene: DistantScene, count: int, first: int = 0) -> list[list[Output]]:
    return [list(dfpc.step(scene.sample(k))) for k in range(first, first + count)]


def test_a_moving_body_is_followed_and_the_ground_is_not() -> None:
    scene, dfpc = DistantScene([Body((50.0, 80.0), (2.3, 0.4))]), compound()
    steps = run(dfpc, scene, 40)
    numbers = {o.value.metadata.track_id for outputs in steps for o in tracks(outputs)}
    assert numbers == {1}
    errors = []
    for k, outputs in enumerate(steps[15:], 15):
        (output,) = tracks(outputs)
        track = output.value
        assert track.metadata.status is CONFIRMED
        assert output.quality.status is Status.OK
        assert output.frame == "robot/camera"
        errors.append(track.data.pixels[0] - scene.bodies[0].place(k))
        azimuth, elevation = track.data.bearings[0, :2]
        u, v = track.data.pixels[0]
        assert azimuth == pytest.approx(np.arctan((u - CAMERA.cx) / CAMERA.fx), abs=2e-3)
        assert elevation == pytest.approx(-np.arctan((v - CAMERA.cy) / CAMERA.fy), abs=2e-3)
        assert np.isnan(track.data.bearings[0, 4:]).all()
        assert "range_unobservable" in output.quality.reasons
    assert np.sqrt(np.mean(np.square(errors))) < 0.3
    detections = next(o.value for o in steps[-1] if o.port == "detections")
    assert detections.detections[0].image_box == pytest.approx(
        [*(scene.bodies[0].place(39) - [10.0, 7.0]), 20.0, 14.0], abs=1.5
    )
    # The registration of the next image leaves out the body with 3 pixels around it.
    rows, columns = np.nonzero(dfpc._tracks.occupied((CAMERA.rows, CAMERA.cols)))
    extent = [columns.min(), rows.min(), columns.max(), rows.max()]
    place, half = scene.bodies[0].place(39), np.array([13.0, 10.0])
    assert extent == pytest.approx([*(place - half), *(place + half)], abs=3.0)


def test_an_empty_scene_and_noise_give_no_track() -> None:
    assert not [o for outputs in run(compound(), DistantScene([]), 30) for o in tracks(outputs)]


def test_a_body_keeps_its_number_behind_an_occluder() -> None:
    scene = DistantScene([Body((30.0, 80.0), (2.5, 0.0))], occluder=(100, 160))
    steps = run(compound(), scene, 70)
    tracks_by_step = [{o.value.metadata.track_id: o for o in tracks(outputs)} for outputs in steps]
    hidden = range(40, 46)
    for k in hidden:
        output = tracks_by_step[k][1]
        assert output.value.metadata.status is COASTING
        assert output.quality.status is Status.DEGRADED
        assert "coasting" in output.quality.reasons
    sigma = [tracks_by_step[k][1].value.data.bearings[0, 2] for k in hidden]
    assert sigma == sorted(sigma)
    assert tracks_by_step[69][1].value.metadata.status is CONFIRMED
    assert tracks_by_step[69][1].value.data.pixels[0] == pytest.approx(scene.bodies[0].place(69), abs=1.0)
    assert {number for s in tracks_by_step[60:] for number in s} == {1}


def test_a_body_that_slows_down_and_turns_behind_an_occluder_is_found_as_it_comes_into_view() -> None:
    occluder = (100, 160)
    before = DistantScene([Body((30.0, 80.0), (2.5, 0.0))], occluder=occluder)
    # The centre is at column 130 in image 40; it reaches the edge of the occluder later than expected.
    after = DistantScene([Body((130.0 - 40 * 1.4, 80.0), (1.4, 0.0), size_px=(17, 14))], occluder=occluder)
    dfpc, found = compound(), []
    for k in range(80):
        sample = (before if k < 40 else after).sample(k)
        for track in tracks(list(dfpc.step(sample))):
            assert track.value.metadata.track_id == 1
            if k > 45 and track.value.metadata.status is CONFIRMED:
                found.append((k, track.value.data.pixels[0]))
    visible_half = next(k for k in range(40, 80) if after.bodies[0].place(k)[0] > 160.0)
    first, place = found[0]
    assert first <= visible_half + 5
    assert place == pytest.approx(after.bodies[0].place(first), abs=6.0)
    assert [k for k, _ in found] == list(range(first, 80))
    assert found[-1][1] == pytest.approx(after.bodies[0].place(79), abs=2.5)  # a side could still be hidden


def test_two_bodies_that_cross_keep_their_numbers() -> None:
    bodies = [
        Body((30.0, 78.0), (2.5, 0.0), level=200.0, seed=3),
        Body((215.0, 84.0), (-2.5, 0.0), (24, 16), level=40.0, seed=4),
    ]
    steps = run(compound(), DistantScene(bodies), 70)
    early = {o.value.metadata.track_id: o.value.data.pixels[0] for o in tracks(steps[20])}
    late = {o.value.metadata.track_id: o.value.data.pixels[0] for o in tracks(steps[69])}
    number = {int(np.argmin([np.linalg.norm(p - b.place(20)) for b in bodies])): n for n, p in early.items()}
    assert sorted(number) == [0, 1]
    for i, body in enumerate(bodies):
        assert late[number[i]] == pytest.approx(body.place(69), abs=1.5)


def test_a_camera_that_turns_sees_the_direction_of_a_body_in_the_frame_of_the_attitude() -> None:
    scene = DistantScene([Body((60.0, 80.0), (3.0, 0.0))], pan_px=1.5)
    dfpc = compound()
    for k in range(30):
        # The image of a camera that turns by a small angle is shifted.
        # A pan of the image to the right is a turn of the camera to the right.
        R = OPTICAL @ se3.exp_so3([0.0, 1.5 * k / CAMERA.fx, 0.0])
        value = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(R, np.zeros(3)), np.zeros((6, 6))),
            parent="inertial",
            child="robot/camera",
            stamp_ns=T0_NS + k * PERIOD_NS,
        )
        dfpc.step(Sample("attitude", T0_NS + k * PERIOD_NS, k, value, id="a", frame="inertial"))
        outputs = list(dfpc.step(scene.sample(k)))
    (output,) = tracks(outputs)
    assert output.frame == "inertial"
    u = (
        OPTICAL
        @ se3.exp_so3([0.0, 1.5 * 29 / CAMERA.fx, 0.0])
        @ CAMERA.rays((scene.bodies[0].place(29) - [1.5 * 29, 0.0])[None])[0]
    )
    azimuth, elevation = output.value.data.bearings[0, :2]
    assert azimuth == pytest.approx(np.arctan2(u[1], u[0]) % (2.0 * np.pi), abs=2e-3)
    assert elevation == pytest.approx(np.arcsin(u[2]), abs=2e-3)


def test_height_stereo_and_terrain_give_range_and_position_in_the_site() -> None:
    disparity = 3.0
    range_m = CAMERA.fx * BASELINE_M / disparity
    body = Body((60.0, 95.0), (2.0, 0.0), disparity_px=disparity)
    scene = DistantScene([body])
    height_m = range_m * body.size_px[1] / CAMERA.fy
    T = se3.transform(OPTICAL, [5.0, 3.0, 2.0])
    by_height = compound(target_height_m=height_m)
    by_stereo = compound()
    for k in range(30):
        for dfpc in (by_height, by_stereo):
            dfpc.step(pose(k, T))
        first, second = list(by_height.step(scene.sample(k))), list(by_stereo.step(scene.pair(k)))
    for outputs in (first, second):
        (output,) = tracks(outputs)
        assert output.frame == "site"
        measured_m, sigma = output.value.data.bearings[0, 4:]
        assert measured_m == pytest.approx(range_m, rel=0.06)
        assert 0.0 < sigma < 0.2 * range_m
        expected = T[:3, :3] @ CAMERA.rays(body.place(29)[None])[0] * range_m + T[:3, 3]
        assert output.value.data.poses[0, :3] == pytest.approx(expected, abs=0.08 * range_m)
        assert output.value.covariances is not None


def test_the_terrain_below_a_body_gives_its_range() -> None:
    scene = DistantScene([Body((60.0, 110.0), (2.0, 0.0))])
    dfpc = compound(target_length_m=0.0)
    grid = GridGeometry("site", 0.5, -50.0, 50.0, 200, 200)
    layers = {
        "mean": np.zeros((200, 200), np.float32),
        "variance": np.full((200, 200), 1e-4, np.float32),
    }
    dem = ElevationMap.from_layers(grid, layers, t0_ns=T0_NS, t1_ns=T0_NS)
    dfpc.step(Sample("dem", T0_NS, 0, dem, id="d", frame="site"))
    for k in range(25):
        dfpc.step(pose(k, se3.transform(OPTICAL, [0.0, 0.0, 2.0])))
        outputs = list(dfpc.step(scene.sample(k)))
    (output,) = tracks(outputs)
    # The lowest row of the body is 117 in an image with the horizon at 79.5.
    depth_m = 2.0 * CAMERA.fy / (117.0 - CAMERA.cy)
    assert output.value.data.bearings[0, 4] == pytest.approx(depth_m, rel=0.06)


def test_without_the_pose_the_registration_continues_the_attitude_and_there_is_no_position() -> None:
    scene, dfpc = DistantScene([Body((60.0, 95.0), (2.0, 0.0))]), compound(target_height_m=1.4)
    T = se3.transform(OPTICAL, [5.0, 3.0, 2.0])
    for k in range(20):
        dfpc.step(pose(k, T))
        list(dfpc.step(scene.sample(k)))
    for k in range(20, 23):
        (output,) = tracks(list(dfpc.step(scene.sample(k))))
    assert (output.frame, output.quality.status) == ("site", Status.DEGRADED)
    assert "attitude_from_images" in output.quality.reasons
    assert output.value.metadata.track_id == 1
    assert np.isfinite(output.value.data.bearings[0, 4])
    assert np.isnan(output.value.data.poses[0, :3]).all()
    u = T[:3, :3] @ CAMERA.rays(scene.bodies[0].place(22)[None])[0]
    azimuth, elevation = output.value.data.bearings[0, :2]
    assert azimuth == pytest.approx(np.arctan2(u[1], u[0]) % (2.0 * np.pi), abs=3e-3)
    assert elevation == pytest.approx(np.arcsin(u[2]), abs=3e-3)


def test_a_pose_and_an_attitude_of_frames_without_a_known_mount_are_named() -> None:
    scene, dfpc = DistantScene([Body((60.0, 95.0), (2.0, 0.0))]), compound()
    for k in range(20):
        unplaced = pose(k, se3.transform(OPTICAL, [5.0, 3.0, 2.0]), child="robot/mast")
        dfpc.step(unplaced)
        dfpc.step(replace(unplaced, port="attitude"))
        outputs = list(dfpc.step(scene.sample(k)))
    (output,) = tracks(outputs)
    assert (output.frame, output.quality.status) == ("robot/camera", Status.DEGRADED)
    assert {"mount_of_pose_unknown", "mount_of_attitude_unknown"} <= set(output.quality.reasons)


def test_the_height_of_a_model_is_used_and_a_flat_one_is_refused() -> None:
    dfpc = compound()
    flat = Mesh.from_arrays(np.zeros((3, 3)), np.array([[0, 1, 2]]), frame="rover/body", stamp_ns=0)
    with pytest.raises(InputError, match="expected a finite one above 0"):
        dfpc.step(Sample("model", T0_NS, 0, flat))
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1.4], [0.0, 1.0, 0.7]])
    model = Mesh.from_arrays(corners, np.array([[0, 1, 2]]), frame="rover/body", stamp_ns=0)
    dfpc.step(Sample("model", T0_NS, 0, model, id="m"))
    scene = DistantScene([Body((60.0, 95.0), (2.0, 0.0))])
    (output,) = tracks(run(dfpc, scene, 20)[-1])
    assert output.value.data.bearings[0, 4] == pytest.approx(1.4 * CAMERA.fy / 14.0, rel=0.1)


def test_a_designated_landmark_at_rest_is_tracked_while_the_camera_turns() -> None:
    scene, dfpc = DistantScene([Body((140.0, 80.0), (0.0, 0.0), (16, 16))], pan_px=1.2), compound()
    box = np.array([132.5, 72.5, 16.0, 16.0])
    message = ObjectDetections(detections=(ObjectDetection(label="lander", score=1.0, image_box=box),))
    dfpc.step(Sample("designation", T0_NS, 0, message, id="box"))
    steps = run(dfpc, scene, 30)
    for k, outputs in enumerate(steps):
        (output,) = tracks(outputs)
        assert output.value.metadata.label == "lander"
        place = scene.bodies[0].place(k) - [1.2 * k, 0.0]
        assert output.value.data.pixels[0] == pytest.approx(place, abs=0.6)


def test_unusable_images_let_objects_coast_with_the_reason() -> None:
    scene, dfpc = DistantScene([Body((50.0, 80.0), (2.3, 0.0))]), compound()
    run(dfpc, scene, 15)
    white = np.full((CAMERA.rows, CAMERA.cols), 255, np.uint8)
    outputs = list(dfpc.step(scene.sample(15, white)))
    (output,) = tracks(outputs)
    assert output.value.metadata.status is COASTING
    assert "no_texture" in output.quality.reasons or "saturated" in output.quality.reasons
    last = run(dfpc, scene, 12, first=16)[-1]
    assert [o.value.metadata.track_id for o in tracks(last)] == [1]
    assert tracks(last)[0].value.metadata.status is CONFIRMED


def test_bad_input_is_refused_by_name() -> None:
    scene, dfpc = DistantScene([]), compound()
    run(dfpc, scene, 2)
    with pytest.raises(InputError, match="expected later than the previous one"):
        dfpc.step(scene.sample(1))
    small = Frame.from_image(
        np.zeros((20, 20), np.uint8), stamp_ns=T0_NS + 10**10, camera_matrix=CAMERA.matrix
    )
    with pytest.raises(InputError, match="expected the size of the previous one"):
        dfpc.step(Sample("image", T0_NS + 10**10, 9, small))
    without = Frame.from_image(scene.image(3), stamp_ns=T0_NS + 10**10)
    with pytest.raises(InputError, match="expected a pinhole, fisheye"):
        dfpc.step(Sample("image", T0_NS + 10**10, 9, without))
    deep = Frame.from_image(
        scene.image(3).astype(np.uint16), stamp_ns=T0_NS + 10**10, camera_matrix=CAMERA.matrix
    )
    with pytest.raises(InputError, match="expected uint8"):
        dfpc.step(Sample("image", T0_NS + 10**10, 9, deep))


def test_predict_continues_the_motion_of_an_object() -> None:
    scene, dfpc = DistantScene([Body((50.0, 80.0), (2.0, 0.0))]), compound()
    run(dfpc, scene, 20)
    later = dfpc.predict(1, T0_NS + 24 * PERIOD_NS)
    u = scene.bodies[0].place(24)[0]
    assert later.data.bearings[0, 0] == pytest.approx(np.arctan((u - CAMERA.cx) / CAMERA.fx), abs=5e-3)
    with pytest.raises(ProductNotFoundError, match="object 7"):
        dfpc.predict(7, -1)
    with pytest.raises(InputError, match="or later"):
        dfpc.predict(1, T0_NS)


def test_the_dpm_finds_the_track_by_its_position_in_the_site(tmp_path: Path) -> None:
    scene = DistantScene([Body((60.0, 95.0), (2.0, 0.0))])
    runner = Runner(compound(target_height_m=1.4))
    T = se3.transform(OPTICAL, [5.0, 3.0, 2.0])
    products = []
    for k in range(25):
        for sample in (pose(k, T), scene.sample(k)):
            runner.push(sample)
            products += list(runner.drain())
    track = [p for p in products if p.port == "track"][-1]
    assert (track.product, track.header.frame) == ("track", "site")
    assert {f"t{24}", "i24"} <= set(track.header.inputs)
    x, y, _ = track.value.data.poses[0, :3]
    with open_store(f"sqlite:///{tmp_path}") as store:
        store.put_all(
            [
                NewProduct(
                    track.header,
                    encode(track.value, "uper"),
                    robot="mana",
                    dfpc=track.dfpc,
                    port=track.port,
                    product=track.product,
                    type_name=track.type_name,
                )
            ]
        )
        near, far = (
            store.search(
                Query(types=("track",), frame="site", region=parse_region(f"circle:{x + dx:.2f},{y:.2f},2"))
            )
            for dx in (0.0, 30.0)
        )
    assert [p.header.id for p in near.items] == [track.header.id]
    assert not far.items
