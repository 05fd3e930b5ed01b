# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of the TUM RGB-D benchmark are read as logs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    cv2.imwrite(str(tmp_path / "rgb" / "a.png"), np.full((480, 640, 3), (1, 2, 3), np.uint8))
    depth = np.zeros((480, 640), np.uint16)
    depth[10, 20] = 5000
    cv2.imwrite(str(tmp_path / "depth" / "a.png"), depth)
    for name in ("rgb", "depth"):
        (tmp_path / f"{name}.txt").write_text(f"# color\n1305031102.175304 {name}/a.png\n", encoding="utf-8")
    (tmp_path / "groundtruth.txt").write_text("1305031102.1758 1 2 3 0 0 0 1\n", encoding="utf-8")
    (tmp_path / "accelerometer.txt").write_text("1305031102.1 0 9 0\n", encoding="utf-8")
    return tmp_path


def test_depth_is_in_metres_and_times_are_exact(recording: Path) -> None:
    log = open_log(recording)
    samples = {s.stream: s for s in log.samples()}
    colour, depth = samples["/tum/colour.frame"], samples["/tum/depth.depth"]
    assert colour.stamp_ns == depth.stamp_ns == 1_305_031_102_175_304_000
    assert tuple(colour.value.image[0, 0]) == (1, 2, 3)
    distances = depth.value.data.reshape(480, 640)
    assert distances[10, 20] == pytest.approx(1.0)
    assert np.count_nonzero(distances) == 1
    assert depth.value.scale_x * 319.5 + depth.value.center_x == pytest.approx(0.0)
    np.testing.assert_allclose(samples["/tum/truth.pose"].value.transform.matrix[:3, 3], [1, 2, 3])
    assert log.unconverted["accelerometer.txt"].count == 1


def test_a_missing_image_is_named_with_its_line(recording: Path) -> None:
    (recording / "rgb" / "a.png").unlink()
    with pytest.raises(InputError, match=r"rgb\.txt:2: rgb/a\.png does not exist"):
        open_log(recording)


def test_a_quaternion_of_another_length_is_refused(recording: Path) -> None:
    (recording / "groundtruth.txt").write_text("1.0 0 0 0 0 0 0 2\n", encoding="utf-8")
    with pytest.raises(InputError, match="expected length 1"):
        open_log(recording)
