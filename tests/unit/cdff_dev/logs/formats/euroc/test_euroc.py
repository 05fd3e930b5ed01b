# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of EuRoC and folders of stereo pairs are read as logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_dev.logs import open_log

T0 = 1_403_636_579_763_555_584
SENSOR = """
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, {x}, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
resolution: [64, 48]
camera_model: pinhole
intrinsics: [60.0, 60.0, 32.0, 24.0]
distortion_model: radial-tangential
distortion_coefficients: [{k1}, 0.0, 0.0, 0.0]
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three images of each camera, of which two have the same time; IMU samples and true poses."""
    for camera, (x, stamps) in enumerate(((0.1, (0, 50, 100)), (0.3, (50, 100, 150)))):
        folder = tmp_path / "mav0" / f"cam{camera}"
        (folder / "data").mkdir(parents=True)
        (folder / "sensor.yaml").write_text(SENSOR.format(x=x, k1=-0.2), encoding="utf-8")
        lines = ["#timestamp [ns],filename"]
        for ms in stamps:
            name = f"{T0 + ms * 10**6}.png"
            cv2.imwrite(str(folder / "data" / name), np.full((48, 64), ms, np.uint8))
            lines.append(f"{T0 + ms * 10**6},{name}")
        (folder / "data.csv").write_text("\n".join(lines), encoding="utf-8")
    imu = tmp_path / "mav0" / "imu0"
    imu.mkdir()
    (imu / "data.csv").write_text(f"#header\n{T0},0.1,0.2,0.3,1.0,2.0,9.8\n", encoding="utf-8")
    truth = tmp_path / "mav0" / "state_groundtruth_estimate0"
    truth.mkdir()
    row = f"{T0},1.0,2.0,3.0,0.0,0.0,0.0,1.0,0,0,0\n"  # w x y z: half a turn about z
    (truth / "data.csv").write_text("#header\n" + row, encoding="utf-8")
    (tmp_path / "mav0" / "leica0").mkdir()
    return tmp_path


def test_images_of_the_same_time_are_pairs_and_the_others_are_listed(recording: Path) -> None:
    log = open_log(recording)
    assert {name: info.count for name, info in log.streams.items()} == {
        "/euroc/imu.imu": 1,
        "/euroc/navcam.pair": 2,
        "/euroc/truth.pose": 1,
    }
    assert log.unconverted["single images"].count == 2
    assert "leica0" in log.unconverted
    first = next(s for s in log.samples() if s.stream == "/euroc/navcam.pair")
    assert first.stamp_ns == (T0 + 50 * 10**6 + 500) // 1000 * 1000
    assert first.value.baseline == pytest.approx(0.2)
    assert first.value.left.T_robot_sensor is not None
    np.testing.assert_allclose(first.value.left.T_robot_sensor.matrix[:3, 3], [0.1, 0.0, 0.0])


def test_rates_forces_and_poses_have_the_order_of_the_types(recording: Path) -> None:
    samples = {s.stream: s.value for s in open_log(recording).samples()}
    imu, pose = samples["/euroc/imu.imu"], samples["/euroc/truth.pose"].transform.matrix
    np.testing.assert_array_equal(imu.gyro, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(imu.acc, [1.0, 2.0, 9.8])
    np.testing.assert_allclose(pose, se3.transform(np.diag([-1.0, -1.0, 1.0]), [1.0, 2.0, 3.0]), atol=1e-12)


def test_a_missing_image_and_a_bad_line_are_named(recording: Path) -> None:
    (recording / "mav0" / "imu0" / "data.csv").write_text("#header\n12,a,b,c,d,e,f\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"data\.csv:2: could not convert"):
        open_log(recording)
    next((recording / "mav0" / "cam0" / "data").iterdir()).unlink()
    with pytest.raises(InputError, match=r"which is not in .*data"):
        open_log(recording)


@pytest.mark.parametrize(("part", "pairs"), [("", 84), ("map", 67), ("query", 17)])
def test_pairs_named_by_their_time_are_rectified(
    real_data: Callable[[str], Path], part: str, pairs: int
) -> None:
    log = open_log(real_data("euroc_v101_pairs") / part)
    assert [info.count for info in log.streams.values()] == [pairs, pairs]
    pair = next(s.value for s in log.samples(["/euroc/navcam.pair"]))
    assert pair.baseline == pytest.approx(0.11, abs=0.001)
    # Features of a rectified pair have the same row.
    orb = cv2.ORB_create(1000)
    (a, da), (b, db) = (orb.detectAndCompute(image.image, None) for image in (pair.left, pair.right))
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(da, db)
    rows = [a[m.queryIdx].pt[1] - b[m.trainIdx].pt[1] for m in matches if m.distance < 30]
    assert len(rows) > 50
    assert abs(np.median(rows)) < 0.5
