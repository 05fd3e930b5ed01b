# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot names the frames of its sensors as it likes."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.dfpc import DfpcContext


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        (("imu", "xsens"), "pico/imu"),
        (("xsens",), "pico/xsens"),
        (("top",), "pico/imu"),
        ((), "pico/imu"),
    ],
)
def test_the_frame_is_the_usual_one_or_that_of_the_sensor_in_the_profile(
    frames: tuple[str, ...], expected: str
) -> None:
    graph = FrameGraph()
    for name in frames:
        graph.set_static("pico/base", f"pico/{name}", UncertainTransform.exact(np.eye(4)))
    sensors = {"top": {"kind": "lidar", "frame": "pico/top"}, "x": {"kind": "imu", "frame": "pico/xsens"}}
    assert DfpcContext("pico", graph, sensors=sensors).sensor_frame("imu", "imu") == expected
