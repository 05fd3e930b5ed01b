# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sequences of 7-Scenes are read as logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_dev.logs import open_log


def test_an_extract_has_colour_depth_and_poses(real_data: Callable[[str], Path]) -> None:
    log = open_log(real_data("seven_scenes_redkitchen"))
    assert [info.count for info in log.streams.values()] == [121, 121, 121]
    depth = next(s for s in log.samples(["/seven_scenes/depth.depth"]))
    assert depth.stamp_ns == 22_000_000_000
    distances = depth.value.data
    assert 0.5 < np.median(distances[distances > 0]) < 5.0
    T = next(s for s in log.samples(["/seven_scenes/truth.pose"])).value.transform.matrix
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)


def test_the_original_layout_has_a_pose_file_for_each_frame(tmp_path: Path) -> None:
    for n in (0, 1):
        stem = tmp_path / f"frame-{n:06d}"
        cv2.imwrite(f"{stem}.color.png", np.zeros((480, 640, 3), np.uint8))
        T = np.eye(4)
        T[0, 3] = n
        np.savetxt(f"{stem}.pose.txt", T)
    log = open_log(tmp_path)
    poses = [s.value.transform.matrix[0, 3] for s in log.samples(["/seven_scenes/truth.pose"])]
    assert poses == pytest.approx([0.0, 1.0])
    assert "/seven_scenes/depth.depth" not in log.streams
