# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cameras of bags: depth images, and a calibration file for bags without ``CameraInfo``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from cdff_common.errors import InputError
from cdff_common.types import FramePair
from cdff_dev.logs import open_log
from cdff_dev.logs.conversion import convert_log
from cdff_dev.slam.estimation import depth_stream, sensor_stream
from cdff_dev.slam.methods import RGBD_SLAM
from services.ros_messages.message_types import RosTypes

TYPES = RosTypes(1)
STAMP_NS = 1_600_000_000_000_000_000
PIXELS = np.arange(24 * 32, dtype=np.uint8).reshape(24, 32)
KALIBR = """
cam0: {camera_model: pinhole, distortion_model: radtan, distortion_coeffs: [0, 0, 0, 0],
       intrinsics: [30, 30, 16, 12], resolution: [32, 24]}
cam1: {camera_model: pinhole, distortion_model: radtan, distortion_coeffs: [0, 0, 0, 0],
       intrinsics: [30, 30, 16, 12], resolution: [32, 24],
       T_cn_cnm1: [[1, 0, 0, -0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
"""
Message = tuple[str, str, Any]


def image(topic: str, pixels: np.ndarray[Any, Any], encoding: str, frame: str = "camera") -> Message:
    message = TYPES.make(
        "sensor_msgs/Image",
        header=TYPES.header(STAMP_NS, frame),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
        data=pixels.reshape(-1).view(np.uint8),
    )
    return topic, "sensor_msgs/msg/Image", message


def info(topic: str, distortion: Sequence[float] = (0.0,) * 5) -> Message:
    region = TYPES.make(
        "sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    message = TYPES.make(
        "sensor_msgs/CameraInfo",
        header=TYPES.header(STAMP_NS, "camera"),
        height=24,
        width=32,
        distortion_model="plumb_bob",
        d=np.array(distortion),
        k=np.array([30.0, 0.0, 16.0, 0.0, 30.0, 12.0, 0.0, 0.0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([30.0, 0.0, 16.0, 0.0, 0.0, 30.0, 12.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=region,
    )
    return topic, "sensor_msgs/msg/CameraInfo", message


def write(path: Path, *messages: Message) -> Path:
    with Writer(path) as bag:
        for topic, kind, message in messages:
            connection = bag.add_connection(topic, kind, typestore=TYPES.store)
            bag.write(connection, STAMP_NS, TYPES.serialize(message, kind))
    return path


def test_images_without_calibrations_are_pairs_with_a_calibration_file(tmp_path: Path) -> None:
    bag = write(
        tmp_path / "run.bag",
        image("/cam0/image_raw", PIXELS, "mono8", "cam0"),
        image("/cam1/image_raw", PIXELS[:, ::-1].copy(), "mono8", "cam1"),
    )
    with open_log(bag) as log:
        assert set(log.streams) == {"/run/cam0_image_raw.frame", "/run/cam1_image_raw.frame"}
        assert "--calibration FILE" in log.unconverted["pairs of /cam0/image_raw"].reason
    (tmp_path / "calibration.yaml").write_text(KALIBR, encoding="utf-8")
    with open_log(bag, tmp_path / "calibration.yaml") as log:
        assert list(log.streams) == ["/run/stereo.pair"]
        pair = next(log.samples()).value
    assert isinstance(pair, FramePair)
    assert pair.baseline == pytest.approx(0.2)
    assert pair.left.camera_matrix[0, 0] == pytest.approx(30.0)
    np.testing.assert_array_equal(pair.right.image, PIXELS[:, ::-1])


def test_a_calibration_without_images_and_one_of_a_converted_log_are_refused(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text(KALIBR, encoding="utf-8")
    bag = write(tmp_path / "run.bag", info("/camera/camera_info"))
    with pytest.raises(InputError, match="no images for the calibration"):
        open_log(bag, tmp_path / "calibration.yaml")
    source = write(tmp_path / "images.bag", image("/camera/image_raw", PIXELS, "mono8"))
    with open_log(source) as log:
        convert_log(log, tmp_path / "converted.bag")
    with pytest.raises(InputError, match="a converted log with its own cameras"):
        open_log(tmp_path / "converted.bag", tmp_path / "calibration.yaml")


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_depth_images_are_distances_in_metres(encoding: str, tmp_path: Path) -> None:
    metres = np.full((24, 32), 1.5, np.float32)
    metres[0, 0] = np.nan
    pixels = metres if encoding == "32FC1" else np.nan_to_num(metres * 1000).astype(np.uint16)
    bag = write(
        tmp_path / "run.bag",
        image("/camera/depth/image_rect_raw", pixels, encoding),
        info("/camera/depth/camera_info"),
    )
    with open_log(bag) as log:
        (sample,) = log.samples()
        assert log.unconverted == {}
        convert_log(log, tmp_path / "copy.bag")
    assert (sample.stream, sample.type_name) == ("/run/camera_depth_image_rect_raw.depth", "DistanceImage")
    assert sample.value.data[:2] == pytest.approx([0.0, 1.5])
    assert sample.value.scale_x == pytest.approx(1 / 30)
    with open_log(tmp_path / "copy.bag") as log:
        (copy,) = log.samples()
    assert (copy.stream, copy.type_name) == (sample.stream, "DistanceImage")
    np.testing.assert_allclose(copy.value.data, sample.value.data)


def test_depth_images_without_a_usable_camera_are_listed(tmp_path: Path) -> None:
    depths = np.full((24, 32), 1500, np.uint16)
    bag = write(
        tmp_path / "run.bag",
        image("/a/depth/image_raw", depths, "16UC1"),
        image("/b/depth/image_raw", depths, "16UC1"),
        info("/b/depth/camera_info", (0.1, 0.0, 0.0, 0.0, 0.0)),
    )
    with open_log(bag) as log:
        assert {stream.type_name for stream in log.streams.values()} == {"Frame"}
        reasons = {name: item.reason for name, item in log.unconverted.items()}
    assert "no CameraInfo" in reasons["distances of /a/depth/image_raw"]
    assert "lens distortion" in reasons["distances of /b/depth/image_raw"]


def test_of_several_depth_images_those_in_the_frame_of_the_colour_camera_are_used(tmp_path: Path) -> None:
    depths = np.full((24, 32), 1500, np.uint16)
    topics = {"/color": "mono8", "/depth": "16UC1", "/aligned_depth_to_color": "16UC1"}
    frames = {"/depth": "depth_optical"}
    bag = write(
        tmp_path / "run.bag",
        *(
            image(f"{t}/image_raw", PIXELS if e == "mono8" else depths, e, frames.get(t, "color_optical"))
            for t, e in topics.items()
        ),
        *(info(f"{topic}/camera_info") for topic in topics),
    )
    with open_log(bag) as log:
        images = sensor_stream(RGBD_SLAM, log)
        assert images == "/run/color_image_raw.frame"
        assert depth_stream(log, images) == "/run/aligned_depth_to_color_image_raw.depth"
