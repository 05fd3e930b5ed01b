# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Masks of cameras belong to the camera with the frame of the image."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from cdff_core.imaging.masks import camera_entry

FRONT = {"kind": "stereo_camera", "frame": "front"}
REAR = {"kind": "stereo_camera", "frame": "rear"}
LIDAR = {"kind": "lidar", "frame": "top"}


def test_the_camera_with_the_frame_is_found_among_several() -> None:
    sensors = {"lidar": LIDAR, "a": FRONT, "b": REAR}
    assert camera_entry(sensors, "rear") is REAR
    assert camera_entry(sensors, "front") is FRONT
    assert camera_entry(sensors, "top") == {}


def test_a_single_camera_matches_any_frame() -> None:
    assert camera_entry({"lidar": LIDAR, "a": FRONT}, "unknown") is FRONT
    assert camera_entry({"lidar": LIDAR}, "top") == {}


@pytest.mark.parametrize("side", ["mask", "mask_right"])
def test_an_unknown_frame_is_refused_if_one_of_several_cameras_has_a_mask(side: str) -> None:
    sensors = {"a": FRONT, "b": REAR | {side: "arm.png"}}
    with pytest.raises(InputError, match="front, rear"):
        camera_entry(sensors, "unknown")
