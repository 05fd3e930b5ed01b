# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Clouds and images of ROS become CDFF types."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.contract.foreign_names import robot_name, stream_name
from cdff_common.errors import InputError
from services.ros_messages.clouds import lidar_scan
from services.ros_messages.conversions import CONVERSIONS
from services.ros_messages.images import frame
from services.ros_messages.topics import Topic

STAMP_NS = 1_600_000_000_000_000_000
TOPIC = Topic("/camera/image_raw", "rover", CONVERSIONS["sensor_msgs/msg/Image"])
_HEADER = SimpleNamespace(frame_id="velodyne")
_NUMBER = {"f4": 7, "f8": 8, "u2": 4, "u4": 6, "u1": 2}


def cloud(points: np.ndarray[Any, Any], padding: int = 0) -> SimpleNamespace:
    """A message with the fields of a structured array, each row followed by unused bytes."""
    fields = [
        SimpleNamespace(name=n, offset=offset, datatype=_NUMBER[kind.str[1:]])
        for n, (kind, offset, *_) in (points.dtype.fields or {}).items()
    ]
    data = np.frombuffer(points.tobytes() + bytes(padding), np.uint8)
    size = points.dtype.itemsize
    return SimpleNamespace(
        header=_HEADER,
        fields=fields,
        data=data,
        height=1,
        width=len(points),
        point_step=size,
        row_step=size * len(points) + padding,
        is_bigendian=False,
    )


def lidar_points(time: str, times: list[float]) -> np.ndarray[Any, Any]:
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), (time, "<f8")]
    points = np.zeros(len(times), kinds if time != "t" else [*kinds[:-1], ("t", "<u4")])
    points["x"], points["ring"], points["intensity"] = np.arange(len(times)), 7, [0.0, 100.0, 255.0]
    points[time] = times
    return points


@pytest.mark.parametrize(
    ("name", "times"),
    [("time", [-0.1, -0.05, 0.0]), ("timestamp", [STAMP_NS / 1e9 + t for t in (-0.1, -0.05, 0.0)])],
)
def test_times_of_points_are_relative_to_the_start_of_the_sweep(name: str, times: list[float]) -> None:
    scan, frame_id, _ = lidar_scan(cloud(lidar_points(name, times), padding=3), TOPIC, STAMP_NS)
    assert frame_id == scan.frame == "rover/velodyne"
    np.testing.assert_allclose(scan.time_offset_us, [0, 50_000, 100_000], atol=1)
    assert scan.t0_ns == pytest.approx(STAMP_NS - 100_000_000, abs=1000)
    assert scan.ring is not None
    assert scan.intensity is not None
    np.testing.assert_array_equal(scan.intensity, [0, 25_700, 65_535])


def test_times_in_nanoseconds_follow_the_stamp() -> None:
    scan, _, _ = lidar_scan(cloud(lidar_points("t", [0, 1_000_000, 2_000_000])), TOPIC, STAMP_NS)
    np.testing.assert_array_equal(scan.time_offset_us, [0, 1000, 2000])
    assert scan.t0_ns == STAMP_NS


def test_points_that_are_not_finite_are_left_out() -> None:
    points = lidar_points("time", [0.0, 0.0, 0.0])
    points["y"][1] = np.nan
    scan, _, _ = lidar_scan(cloud(points), TOPIC, STAMP_NS)
    np.testing.assert_array_equal(scan.points_m[:, 0], [0.0, 2.0])


def test_clouds_without_coordinates_or_with_missing_data_are_refused() -> None:
    points = lidar_points("time", [0.0, 0.0, 0.0])
    without = cloud(points)
    without.fields = without.fields[1:]
    with pytest.raises(InputError, match="expected x, y and z"):
        lidar_scan(without, TOPIC, STAMP_NS)
    short = cloud(points)
    short.data = short.data[:-1]
    with pytest.raises(InputError, match="expected 1 rows"):
        lidar_scan(short, TOPIC, STAMP_NS)


@pytest.mark.parametrize("offset", [2**31 - 1, 2**31 - 4, 2**32 - 1, -4, 23])
def test_fields_outside_a_point_are_refused(offset: int) -> None:
    message = cloud(lidar_points("time", [0.0, 0.0, 0.0]))
    message.fields[1].offset = offset
    with pytest.raises(InputError, match=rf"field 'y' at byte {offset}: .* 26 bytes"):
        lidar_scan(message, TOPIC, STAMP_NS)


@pytest.mark.parametrize(
    ("encoding", "shape", "dtype"),
    [("mono8", (2, 3), "u1"), ("mono16", (2, 3), "<u2"), ("bgr8", (2, 3, 3), "u1")],
)
def test_images_keep_their_pixels_in_padded_rows(
    encoding: str, shape: tuple[int, ...], dtype: str, rng: np.random.Generator
) -> None:
    image = rng.integers(0, 200, shape).astype(dtype)
    rows = image.reshape(2, -1).view(np.uint8)
    padded = np.concatenate([rows, np.zeros((2, 5), np.uint8)], axis=1)
    message = SimpleNamespace(
        header=_HEADER,
        encoding=encoding,
        height=2,
        width=3,
        step=padded.shape[1],
        is_bigendian=False,
        data=padded.ravel(),
    )
    value, _, _ = frame(message, TOPIC, STAMP_NS)
    np.testing.assert_array_equal(value.image, image)
    message.data = message.data[:-1]
    with pytest.raises(InputError, match="expected 2 rows"):
        frame(message, TOPIC, STAMP_NS)
    message.encoding = "bayer"
    with pytest.raises(InputError, match="'bayer'"):
        frame(message, TOPIC, STAMP_NS)


def test_compressed_images_are_decoded(rng: np.random.Generator) -> None:
    image = rng.integers(0, 255, (4, 5), np.uint8)
    data = cv2.imencode(".png", image)[1].ravel()
    value, _, _ = frame(SimpleNamespace(header=_HEADER, format="png", data=data), TOPIC, STAMP_NS)
    np.testing.assert_array_equal(value.image, image)
    with pytest.raises(InputError, match="not an image"):
        frame(SimpleNamespace(header=_HEADER, format="png", data=data[:20]), TOPIC, STAMP_NS)


def test_names_are_those_of_a_profile(tmp_path: Any) -> None:
    assert robot_name(tmp_path / "2015-05-21 Husky.bag") == "robot_2015_05_21_husky"
    assert stream_name("husky", "/Camera/Left/image_raw", "frame") == "/husky/camera_left_image_raw.frame"


@pytest.mark.parametrize(
    ("name", "focal_px", "distortion"), [("image_raw", 300.0, 2), ("image_rect", 280.0, 0)]
)
@pytest.mark.parametrize("capital", [False, True])
def test_images_have_the_calibration_of_their_camera(
    name: str, focal_px: float, distortion: int, capital: bool
) -> None:
    K, P = np.diag([300.0, 300.0, 1.0]), np.diag([280.0, 280.0, 1.0, 0.0])[:3]
    fields = {"k": K.ravel(), "d": [0.1, 0.01], "p": P.ravel()}
    camera = SimpleNamespace(
        distortion_model="plumb_bob", **{k.upper() if capital else k: v for k, v in fields.items()}
    )
    topic = replace(TOPIC, name=f"/camera/{name}", camera=camera)
    message = SimpleNamespace(
        header=_HEADER,
        encoding="mono8",
        height=2,
        width=3,
        step=3,
        is_bigendian=False,
        data=np.zeros(6, "u1"),
    )
    value, _, _ = frame(message, topic, STAMP_NS)
    assert value.camera_matrix[0, 0] == focal_px
    assert len(value.intrinsic.dist_coeffs) == distortion
    camera.distortion_model = "double_sphere"
    if distortion:
        with pytest.raises(InputError, match="double_sphere"):
            frame(message, topic, STAMP_NS)
