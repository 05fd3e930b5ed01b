# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/tracks``: states of tracked objects over time; the frame of a client among the poses."""

from __future__ import annotations

import numpy as np
import pytest
from fastapi.testclient import TestClient

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.profile import Profile
from cdff_common.types import ObjectTrack, TransformWithCovariance
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.profile_entry import enter
from tests.support.dpm_products import S, bearing_track, pose, pose_track, put_arguments


def test_states_are_grouped_by_object_in_the_order_of_time(http: TestClient, dpm: Dpm) -> None:
    for second, (number, range_m) in enumerate([(1, np.nan), (2, np.nan), (1, 200.0), (1, 190.0)]):
        track = bearing_track(second, 6.2 + 0.01 * second, range_m, number)
        dpm.writer.put(*put_arguments(track, "track", second, frame="inertial"))
    objects = {o["id"]: o for o in http.get("/api/v1/tracks").json()["items"]}
    assert set(objects) == {1, 2}
    first = objects[1]
    assert (first["robot"], first["frame"], first["label"]) == ("mana", "inertial", "target")
    assert [s["stamp_ns"] for s in first["states"]] == [str(k * S) for k in (0, 2, 3)]
    assert [s["range_m"] for s in first["states"]] == [None, 200.0, 190.0]
    assert first["states"][-1]["azimuth_rad"] == pytest.approx(6.23)
    assert first["states"][-1]["sigma_range_m"] == pytest.approx(19.0)
    assert {s["status"] for s in first["states"]} == {"confirmed"}


def test_states_are_selected_by_robot_frame_and_time_and_the_newest_are_kept(
    http: TestClient, dpm: Dpm
) -> None:
    for second in range(6):
        dpm.writer.put(*put_arguments(bearing_track(second, 0.1), "track", second, frame="inertial"))
    ask = "/api/v1/tracks"
    assert http.get(ask, params={"robot": "minnie"}).json()["items"] == []
    assert http.get(ask, params={"frame": "mana/lvlh"}).json()["items"] == []
    (some,) = http.get(ask, params={"t0": str(2 * S), "t1": str(4 * S), "robot": "mana"}).json()["items"]
    assert [s["stamp_ns"] for s in some["states"]] == [str(k * S) for k in (2, 3, 4)]
    (newest,) = http.get(ask, params={"limit": "2", "frame": "inertial"}).json()["items"]
    assert [s["stamp_ns"] for s in newest["states"]] == [str(k * S) for k in (4, 5)]
    assert http.get(ask, params={"limit": "1001"}).status_code == 422


def test_the_frame_of_a_client_is_found_relative_to_the_servicer(http: TestClient, dpm: Dpm) -> None:
    robot = {
        "id": "servicer",
        "frames": [
            {
                "parent": "servicer/base",
                "child": "servicer/far_camera",
                "quaternion_xyzw": [-0.5, 0.5, -0.5, 0.5],
            }
        ],
    }
    enter(
        dpm.store, Profile.model_validate({"name": "o", "orbit": {"clients": ["client"]}, "robots": [robot]})
    )
    for second in (0, 2):
        T = UncertainTransform(se3.transform(np.eye(3), [0.0, 0.0, 100.0 - second]), 0.01 * np.eye(6))
        value = TransformWithCovariance.from_transform(
            T, parent="servicer/far_camera", child="client/body", stamp_ns=second * S
        )
        names = {"frame": "servicer/far_camera", "child": "client/body", "robot": "servicer"}
        dpm.writer.put(*put_arguments(value, "pose", second, **names))
    query = {"robot": "servicer", "frame": "servicer/base", "child": "client/body", "t": str(S)}
    (pose,) = http.get("/api/v1/poses", params=query).json()["items"]
    # The camera looks along the x axis of the base.
    assert [row[3] for row in pose["T"]][:3] == pytest.approx([99.0, 0.0, 0.0])
    frames = http.get("/api/v1/frames").json()["tracks"]
    assert [(t["child"], t["parent"]) for t in frames] == [("client/body", "servicer/far_camera")]


def test_positions_are_listed_with_their_covariances_in_the_frame_that_is_asked_for(
    http: TestClient, dpm: Dpm
) -> None:
    """The robot is at x = 2 m with a variance of 0.01 per axis; the object is 3 m ahead of it."""
    dpm.writer.put(*put_arguments(pose(2, 2.0), "pose", 2, child="mana/base"))
    track = pose_track([1, 2], [[4.0, 0.0, 0.0], [3.0, 0.0, 0.0]], frame="mana/base")
    dpm.writer.put(*put_arguments(track, "track", 2, frame="mana/base"))
    (item,) = http.get("/api/v1/tracks").json()["items"]
    assert (item["frame"], item["position_frame"], item["dfpc"]) == ("mana/base", "mana/base", "test")
    assert [s["position_m"][0] for s in item["states"]] == [4.0, 3.0]
    assert {s["azimuth_rad"] for s in item["states"]} == {None}
    (item,) = http.get("/api/v1/tracks", params={"position_frame": "site"}).json()["items"]
    assert item["position_frame"] == "site"
    earlier, last = item["states"]
    assert earlier["position_m"] is None  # no pose of the robot is known a second earlier
    assert last["position_m"] == pytest.approx([5.0, 0.0, 0.0])
    # Across the direction to the object, the rotation variance of the robot adds 3² · 0.01 at 3 m.
    assert np.diag(last["position_covariance"]) == pytest.approx([0.05, 0.1 + 0.09, 0.05 + 0.09])
    (item,) = http.get("/api/v1/tracks", params={"position_frame": "minnie/base"}).json()["items"]
    assert {s["position_m"] is None for s in item["states"]} == {True}


def test_states_that_several_products_of_a_track_repeat_are_listed_once(http: TestClient, dpm: Dpm) -> None:
    for second in (2, 3):
        stamps = [second - 1, second]
        track = pose_track(stamps, [[float(s), 0.0, 0.0] for s in stamps], frame="site")
        dpm.writer.put(*put_arguments(track, "track", second))
    (item,) = http.get("/api/v1/tracks").json()["items"]
    assert [s["stamp_ns"] for s in item["states"]] == [str(k * S) for k in (1, 2, 3)]
    (newest,) = http.get("/api/v1/tracks", params={"limit": "2"}).json()["items"]
    assert [s["stamp_ns"] for s in newest["states"]] == [str(k * S) for k in (2, 3)]


def test_a_track_without_a_covariance_has_positions_of_unknown_error(http: TestClient, dpm: Dpm) -> None:
    track = ObjectTrack.from_arrays(1, [S], [np.eye(4)], frame="site")
    dpm.writer.put(*put_arguments(track, "track", 1))
    (item,) = http.get("/api/v1/tracks").json()["items"]
    (state,) = item["states"]
    assert (state["position_m"], state["position_covariance"]) == ([0.0, 0.0, 0.0], None)


def test_the_newest_pose_and_a_thinned_path_are_returned_however_many_poses_there_are(
    http: TestClient, dpm: Dpm
) -> None:
    for second in range(5):
        dpm.writer.put(*put_arguments(pose(second, float(second)), "pose", second, child="mana/base"))
    ask = {"robot": "mana", "limit": "2"}
    assert http.get("/api/v1/poses", params=ask).status_code == 422
    thinned = http.get("/api/v1/poses", params=ask | {"thin": "true"}).json()["items"]
    assert [pose["T"][0][3] for pose in thinned] == [0.0, 3.0, 4.0]
    (newest,) = http.get("/api/v1/poses", params=ask | {"newest": "true"}).json()["items"]
    assert newest["T"][0][3] == 4.0
    assert http.get("/api/v1/poses", params=ask | {"newest": "true", "t": "0"}).status_code == 422
