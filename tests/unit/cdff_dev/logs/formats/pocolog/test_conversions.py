# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of ROCK become CDFF messages with the right units, frames and times, in both byte orders."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.errors import CodecError
from cdff_common.geometry import se3
from cdff_common.types import FrameModeT
from cdff_dev.logs import open_log
from tests.support import pocolog_files as rock

T0_US = 1_600_000_000_000_000
NAN3, NAN9 = {"data": [np.nan] * 3}, {"data": [np.nan] * 9}


@pytest.fixture(params=["<", ">"])
def order(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def converted(tmp_path: Path, kind: Any, value: Any, order: str = "<", keep: bool = False) -> dict[str, Any]:
    """Return the values of the streams of a log with one sample."""
    writer = rock.PocologWriter(order)
    writer.declare(0, "/task.port", kind)
    writer.sample(0, kind, value, T0_US, keep=keep)
    path = tmp_path / "task.0.log"
    path.write_bytes(writer.data)
    with closing(open_log(path)) as log:
        return {s.stream.removeprefix("/robot/task."): s.value for s in log.samples()}


def test_covariance_of_orientation_is_rotated_from_the_body_into_the_parent(
    tmp_path: Path, order: str
) -> None:
    half = np.sqrt(0.5)  # 90 degrees about z: x of the body is y of the parent
    value = {
        "time": rock.time(T0_US + 5),
        "sourceFrame": "body",
        "targetFrame": "world",
        "position": {"data": [1.0, 2.0, 3.0]},
        "cov_position": {"data": list(np.diag([1.0, 2.0, 3.0]).ravel())},
        "orientation": {"im": [0.0, 0.0, half], "re": half},
        "cov_orientation": {"data": list(np.diag([0.1, 0.2, 0.3]).ravel())},
        "velocity": {"data": [0.5, 0.0, 0.0]},
        "cov_velocity": {"data": [float(i) for i in range(9)]},
        "angular_velocity": NAN3,
        "cov_angular_velocity": NAN9,
    }
    streams = converted(tmp_path, rock.BODY_STATE, value, order)
    T = streams["port"].transform
    np.testing.assert_allclose(T.matrix[:3], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]], atol=1e-12)
    np.testing.assert_allclose(T.covariance, np.diag([1.0, 2.0, 3.0, 0.2, 0.1, 0.3]), atol=1e-12)
    state = streams["port_state"]
    np.testing.assert_array_equal(state.velocity, [0.5, 0.0, 0.0])
    np.testing.assert_array_equal(state.cov_velocity, np.arange(9.0).reshape(3, 3).T)
    assert np.isnan(state.angular_velocity).all()


def test_infinite_covariance_is_unknown(tmp_path: Path) -> None:
    value = {name: NAN9 if "cov" in name else NAN3 for name in rock.BODY_STATE.fields}
    value |= {
        "time": rock.time(T0_US),
        "sourceFrame": "a",
        "targetFrame": "b",
        "position": {"data": [0.0] * 3},
    }
    value |= {"orientation": {"im": [0.0] * 3, "re": 1.0}, "cov_position": {"data": [np.inf] * 9}}
    assert converted(tmp_path, rock.BODY_STATE, value)["port"].transform.covariance is None


@pytest.mark.parametrize("is_new", [True, False])
def test_covariance_of_transforms_is_that_of_small_rotations_in_the_parent(
    tmp_path: Path, order: str, is_new: bool
) -> None:
    rng = np.random.default_rng(3)
    r, translation = np.array([0.4, -0.9, 1.3]), [1.0, 2.0, 3.0]
    root = rng.normal(size=(6, 6)) * 1e-3
    cov = root @ root.T  # of translation and coordinates of the rotation vector
    x, y, z, w = se3.quaternion_xyzw_from_matrix(se3.exp_so3(r))
    value = {"translation": {"data": translation}, "orientation": {"im": [x, y, z], "re": w}}
    kind, written = rock.TRANSFORM, cov
    if not is_new:  # orientation first, also in the covariance
        angle = float(np.linalg.norm(r))
        value = {"rotation": {"angle": angle, "axis": list(r / angle)}, "translation": {"data": translation}}
        kind = rock.Compound(
            kind.name, {"rotation": rock.ANGLE_AXIS, "translation": rock.VECTOR3, "cov": rock.MATRIX6}
        )
        written = np.roll(cov, (3, 3), axis=(0, 1))
    value["cov"] = {"data": list(written.T.ravel())}
    T = converted(tmp_path, kind, value, order)["port"].transform
    np.testing.assert_allclose(T.matrix[:3, :3], se3.exp_so3(r), atol=1e-12)
    errors = rng.multivariate_normal(np.zeros(6), cov, 20_000)
    rotations = se3.log_so3(se3.exp_so3(r + errors[:, 3:]) @ se3.exp_so3(r).T)
    sampled = np.cov(np.hstack([errors[:, :3], rotations]).T)
    np.testing.assert_allclose(T.covariance, sampled, atol=0.05 * np.abs(sampled).max())


def test_states_of_bodies_have_covariances_of_pose_and_velocity(tmp_path: Path) -> None:
    diagonal = np.diag(np.arange(1.0, 7.0))
    pose = {"translation": {"data": [1.0, 2.0, 3.0]}, "orientation": {"im": [0.0] * 3, "re": 1.0}}
    pose |= {"cov": {"data": list(diagonal.ravel())}}
    velocity = {"vel": {"data": [4.0, 5.0, 6.0]}, "rot": NAN3, "cov": {"data": list(2.0 * diagonal.ravel())}}
    value = {"time": rock.time(T0_US), "pose": pose, "velocity": velocity}
    body = converted(tmp_path, rock.BODY, value)["port"]
    np.testing.assert_array_equal(body.pose.transform.covariance, diagonal)
    np.testing.assert_array_equal(body.velocity.data.cov, 2.0 * diagonal)
    pose["cov"] = {"data": [np.inf] * 36}
    assert converted(tmp_path, rock.BODY, value)["port"].pose.transform.covariance is None


def test_joints_have_names_states_and_time(tmp_path: Path, order: str) -> None:
    columns = list(rock.JOINT_STATE.fields)
    states = [dict(zip(columns, np.arange(5.0) + 5 * k, strict=True)) for k in range(2)]
    value = {"names": ["j1", "j2"], "elements": states, "time": rock.time(T0_US + 9)}
    joints = converted(tmp_path, rock.JOINTS, value, order)["port"]
    assert joints.names == ("j1", "j2")
    assert joints.stamp_ns == (T0_US + 9) * 1000
    assert [getattr(joints.elements[1], name) for name in columns] == [5.0, 6.0, 7.0, 8.0, 9.0]


def test_trajectories_of_joints_keep_their_rows(tmp_path: Path) -> None:
    kind = rock.Compound(
        "/base/JointsTrajectory",
        {
            "names": rock.Vector(rock.String()),
            "elements": rock.Vector(rock.Vector(rock.JOINT_STATE)),
            "times": rock.Vector(rock.TIME),
        },
    )
    state = dict.fromkeys(rock.JOINT_STATE.fields, 1.0)
    value = {"names": ["a"], "elements": [[state, state]], "times": [rock.time(1), rock.time(2)]}
    path = converted(tmp_path, kind, value)["port"]
    assert path.vector_name == ("a",)
    assert [t.microseconds for t in path.timetags] == [1, 2]
    assert len(path.trajectory[0]) == 2


def depth_map(rows: int, cols: int, **fields: Any) -> dict[str, Any]:
    return {
        "time": rock.time(T0_US),
        "timestamps": [],
        "vertical_projection": "POLAR",
        "horizontal_projection": "POLAR",
        "vertical_interval": [0.0],
        "horizontal_interval": [0.0],
        "vertical_size": rows,
        "horizontal_size": cols,
        "distances": [1.0] * (rows * cols),
        "remissions": [],
        **fields,
    }


def test_polar_depth_maps_turn_rows_downwards_and_columns_to_the_right(tmp_path: Path, order: str) -> None:
    value = depth_map(
        2, 3, vertical_interval=[-0.2, 0.2], horizontal_interval=[0.5, -0.5], distances=[2.0] * 6
    )
    value["remissions"] = [0.0, 0.5, 1.0] * 2
    scan = converted(tmp_path, rock.DEPTH_MAP, value, order)["port"]
    x, y, z = scan.points_m.T
    np.testing.assert_allclose(np.arcsin(z / 2.0), np.repeat([0.2, -0.2], 3), atol=1e-6)
    np.testing.assert_allclose(np.arctan2(y, x), np.tile([0.5, 0.0, -0.5], 2), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(scan.points_m, axis=1), 2.0, rtol=1e-6)
    np.testing.assert_array_equal(scan.ring, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(scan.intensity[:3], [0, 32768, 65535])


def test_planar_depth_maps_have_coordinates_on_the_image_plane(tmp_path: Path) -> None:
    value = depth_map(1, 3, horizontal_projection="PLANAR", horizontal_interval=[-0.5, 0.0, 0.5])
    scan = converted(tmp_path, rock.DEPTH_MAP, value)["port"]
    np.testing.assert_allclose(scan.points_m[:, 1] / scan.points_m[:, 0], [0.5, 0.0, -0.5], atol=1e-6)
    value = depth_map(2, 1, vertical_projection="PLANAR", vertical_interval=[-0.5, 0.5])
    scan = converted(tmp_path, rock.DEPTH_MAP, value)["port"]
    np.testing.assert_allclose(scan.points_m[:, 2] / scan.points_m[:, 0], [0.5, -0.5], atol=1e-6)


def test_a_full_turn_has_equal_limits(tmp_path: Path) -> None:
    value = depth_map(1, 5, horizontal_interval=[np.pi, np.pi])
    scan = converted(tmp_path, rock.DEPTH_MAP, value)["port"]
    np.testing.assert_allclose(scan.points_m[:, 0], [-1.0, 0.0, 1.0, 0.0, -1.0], atol=1e-6)
    np.testing.assert_allclose(scan.points_m[:, 1], [0.0, 1.0, 0.0, -1.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([], [0] * 6),
        ([5], [0] * 6),
        ([0, 20], [0, 0, 0, 20, 20, 20]),
        ([0, 7, 9], [0, 7, 9] * 2),
        ([6, 5, 4, 3, 2, 1], [5, 4, 3, 2, 1, 0]),
    ],
)
def test_measurements_of_depth_maps_have_times(tmp_path: Path, times: list[int], expected: list[int]) -> None:
    value = depth_map(2, 3, timestamps=[rock.time(T0_US + t) for t in times])
    scan = converted(tmp_path, rock.DEPTH_MAP, value)["port"]
    np.testing.assert_array_equal(scan.time_offset_us, expected)


def test_invalid_measurements_have_no_points(tmp_path: Path) -> None:
    value = depth_map(1, 4, distances=[np.nan, np.inf, 0.0, 3.0])
    np.testing.assert_allclose(converted(tmp_path, rock.DEPTH_MAP, value)["port"].points_m, [[3.0, 0, 0]])
    scan = {
        "time": rock.time(T0_US),
        "start_angle": 0.0,
        "angular_resolution": 0.1,
        "speed": 0.0,
        "ranges": [2, 500, 1000, 9000],
        "minRange": 600,
        "maxRange": 8000,
        "remission": [1.0, 2.0, 300.4, 4.0],
    }
    points = converted(tmp_path, rock.LASER_SCAN, scan)["port"]
    np.testing.assert_allclose(points.points_m, [[np.cos(0.2), np.sin(0.2), 0.0]], atol=1e-6)
    np.testing.assert_array_equal(points.intensity, [300])
    assert points.t0_ns == T0_US * 1000


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_a_laser_scan_begins_when_the_mirror_points_backwards(tmp_path: Path, speed: float) -> None:
    angles = np.array([0.0, np.pi / 2]) * np.sign(speed)
    value = {"time": rock.time(T0_US), "start_angle": 0.0, "angular_resolution": angles[1], "speed": speed}
    value |= {"ranges": [1000, 1000], "minRange": 0, "maxRange": 5000, "remission": []}
    offsets_us = converted(tmp_path, rock.LASER_SCAN, value)["port"].time_offset_us
    np.testing.assert_allclose(offsets_us, np.array([np.pi, 1.5 * np.pi]) / 2.0 * 1e6, atol=1)


def test_clouds_keep_finite_points_and_colours(tmp_path: Path, order: str) -> None:
    points = [{"data": [1.0, 2.0, 3.0]}, NAN3, {"data": [4.0, 5.0, 6.0]}]
    colors = [{"data": [0.1 * k, 0.2, 0.3, 1.0]} for k in range(3)]
    value = {"time": rock.time(T0_US), "points": points, "colors": colors}
    cloud = converted(tmp_path, rock.POINTCLOUD, value, order)["port"]
    np.testing.assert_array_equal(cloud.points_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(cloud.colors[:, 0], [0.0, 0.2])
    assert cloud.frame == "robot/task"


def test_padding_between_fields_is_skipped(tmp_path: Path, order: str) -> None:
    value = {"time": rock.time(T0_US), "width": 2, "height": 1, "data": [1.5, np.nan]}
    value |= {"scale_x": 0.5, "scale_y": 0.25, "center_x": -1.0, "center_y": -2.0}
    assert rock.DISTANCE_IMAGE.offsets["data"] == 32  # after 28 bytes
    image = converted(tmp_path, rock.DISTANCE_IMAGE, value, order)["port"]
    assert (image.width, image.height, image.scale_y, image.center_y) == (2, 1, 0.25, -2.0)
    np.testing.assert_array_equal(image.data, [1.5, np.nan])


@pytest.mark.parametrize("keep", [False, True])
def test_padding_at_the_end_can_be_absent(tmp_path: Path, keep: bool, order: str) -> None:
    left, right = (rock.frame_value(bytes([v] * 6), 3, 2, "MODE_GRAYSCALE", T0_US) for v in (7, 8))
    assert rock.trailing_padding(rock.FRAME_PAIR) == 4
    value = {"time": rock.time(T0_US), "first": left, "second": right, "id": 3}
    pair = converted(tmp_path, rock.FRAME_PAIR, value, order, keep)["port"]
    np.testing.assert_array_equal(pair.left.image, np.full((2, 3), 7))
    np.testing.assert_array_equal(pair.right.image, np.full((2, 3), 8))
    assert (pair.left.frame, pair.right.frame) == ("robot/task_left", "robot/task_right")


def frame(tmp_path: Path, order: str, *args: Any, **kwargs: Any) -> Any:
    return converted(tmp_path, rock.FRAME, rock.frame_value(*args, **kwargs), order)["port"]


@pytest.mark.parametrize(
    ("mode", "channels", "expected"),
    [
        ("MODE_GRAYSCALE", 1, FrameModeT.MODE_GRAY),
        ("MODE_RGB", 3, FrameModeT.MODE_RGB),
        ("MODE_BGR", 3, FrameModeT.MODE_BGR),
        ("MODE_RGB32", 4, FrameModeT.MODE_RGB32),
        ("MODE_BAYER", 1, FrameModeT.MODE_UNDEF),
    ],
)
@pytest.mark.parametrize("depth", [8, 12])
def test_images_keep_their_pixels(
    tmp_path: Path, order: str, mode: str, channels: int, expected: FrameModeT, depth: int
) -> None:
    pixels = np.arange(2 * 3 * channels).reshape(2, 3, channels) + (1000 if depth > 8 else 0)
    data = pixels.astype(f"{order}u{1 if depth == 8 else 2}").tobytes()
    value = frame(tmp_path, order, data, 3, 2, mode, T0_US, depth=depth)
    np.testing.assert_array_equal(value.image, pixels[..., 0] if channels == 1 else pixels)
    assert value.metadata.mode is expected
    assert value.metadata.received_time.ns == (T0_US + 1000) * 1000
    assert [(a.name, a.data) for a in value.metadata.attributes] == [("gain", "2")]


@pytest.mark.parametrize(
    ("pattern", "red"), [("RGGB", (0, 0)), ("GRBG", (0, 1)), ("BGGR", (1, 1)), ("GBRG", (1, 0))]
)
def test_bayer_patterns_become_colours(tmp_path: Path, pattern: str, red: tuple[int, int]) -> None:
    image = np.zeros((8, 8), np.uint8)
    image[red[0] :: 2, red[1] :: 2] = 200
    value = frame(tmp_path, "<", image.tobytes(), 8, 8, f"MODE_BAYER_{pattern}")
    assert value.metadata.mode is FrameModeT.MODE_BGR
    np.testing.assert_array_equal(value.image[2:6, 2:6], np.broadcast_to([0, 0, 200], (4, 4, 3)))


def test_uyvy_becomes_colours(tmp_path: Path) -> None:
    value = frame(tmp_path, "<", bytes([128, 90] * 8), 4, 2, "MODE_UYVY")
    assert value.image.shape == (2, 4, 3)
    assert np.ptp(value.image) == 0  # grey


@pytest.mark.parametrize(
    ("mode", "suffix"), [("MODE_PJPG", ".jpg"), ("MODE_JPEG", ".jpg"), ("MODE_PNG", ".png")]
)
def test_compressed_images_are_decoded(tmp_path: Path, mode: str, suffix: str) -> None:
    image = np.full((4, 6, 3), (10, 120, 240), np.uint8)
    data = cv2.imencode(suffix, image)[1].tobytes()
    value = frame(tmp_path, "<", data, 6, 4, mode)
    np.testing.assert_allclose(value.image, image, atol=3)
    for wrong in (data[:10], data):
        with pytest.raises(CodecError, match=rf"task\.0\.log: /task\.port sample .* {mode} image"):
            frame(tmp_path, "<", wrong, 6, 5, mode)


def test_images_of_the_wrong_size_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CodecError, match="image of 5 bytes: expected 2 rows of 3 bytes"):
        frame(tmp_path, "<", bytes(5), 3, 2, "MODE_GRAYSCALE")


def test_small_types_are_converted(tmp_path: Path, order: str) -> None:
    double, vector = rock.DOUBLE, rock.VECTOR3
    pose = rock.Compound("/base/Pose_m", {"position": vector, "orientation": rock.QUATERNION})
    value = {"position": {"data": [1.0, 2.0, 3.0]}, "orientation": {"im": [0.1, 0.2, 0.3], "re": 0.4}}
    np.testing.assert_array_equal(
        converted(tmp_path, pose, value, order)["port"].orient, [0.1, 0.2, 0.3, 0.4]
    )
    motion = rock.Compound("/base/commands/Motion2D", {"translation": double, "rotation": double})
    assert (
        converted(tmp_path, motion, {"translation": 0.5, "rotation": 0.1}, order)["port"].translation == 0.5
    )
    assert converted(tmp_path, rock.TIME, rock.time(T0_US), order)["port"].microseconds == T0_US
    np.testing.assert_array_equal(converted(tmp_path, vector, NAN3, order)["port"].values, [np.nan] * 3)
    matrix = {"data": [float(k) for k in range(9)]}
    np.testing.assert_array_equal(
        converted(tmp_path, rock.MATRIX3, matrix, order)["port"].values, np.arange(9.0).reshape(3, 3).T
    )
    acceleration = rock.Compound(
        "/base/samples/RigidBodyAcceleration_m",
        {"time": rock.TIME, "acceleration": vector, "cov_acceleration": rock.MATRIX3},
    )
    value = {"time": rock.time(T0_US), "acceleration": {"data": [1.0, 0.0, 0.0]}, "cov_acceleration": NAN9}
    assert converted(tmp_path, acceleration, value, order)["port"].acceleration[0] == 1.0


def test_old_times_have_seconds_and_microseconds(tmp_path: Path) -> None:
    old_time = rock.Compound("/base/Time", {"seconds": rock.INT, "microseconds": rock.INT})
    pressure = rock.Compound("/base/samples/Pressure", {"pascal": rock.FLOAT, "time": old_time})
    value = {"pascal": 1000.0, "time": {"seconds": 1_600_000_000, "microseconds": 7}}
    assert converted(tmp_path, pressure, value)["port"].stamp_ns == (T0_US + 7) * 1000
