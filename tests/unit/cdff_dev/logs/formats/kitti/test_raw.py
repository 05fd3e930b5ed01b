# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drives of the KITTI raw recordings are read as logs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log
from tests.unit.cdff_dev.logs.formats.kitti.test_sequence import P0, P1, sequence

START_NS = 1_317_042_145_000_000_000  # 2011-09-26 13:02:25 UTC
PAIR, TRUTH, IMU, SCAN = (f"/kitti/{name}" for name in ("navcam.pair", "truth.pose", "imu.imu", "lidar.scan"))
MOUNT = "/kitti/lidar.mount"
_NO_ROTATION = "R: 1 0 0 0 1 0 0 0 1"


def stamps(folder: Path, count: int) -> None:
    lines = [f"2011-09-26 13:02:25.{k}00000489" for k in range(count)]
    (folder / "timestamps.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def oxts(k: int) -> str:
    """A vehicle that drives 1e-5 degrees north and turns by 0.1 rad per sample."""
    row = np.zeros(30)
    row[:6] = 49.0 + 1e-5 * k, 8.4, 112.0, 0.0, 0.0, 0.1 * k
    row[11:14], row[17:20] = (0.1, 0.2, 9.8), (0.01, 0.02, 0.03)
    return " ".join(map(str, row))


def drive(folder: Path, *cameras: str, count: int = 3) -> Path:
    for camera in cameras:
        (folder / camera / "data").mkdir(parents=True)
        stamps(folder / camera, count)
        for k in range(count):
            cv2.imwrite(str(folder / camera / "data" / f"{k:010d}.png"), np.full((6, 8, 3), 10 * k, np.uint8))
    for name in ("velodyne_points", "oxts"):
        (folder / name / "data").mkdir(parents=True)
        stamps(folder / name, count)
    for k in range(count):
        rows = np.array([[5.0, 0.1 * k, -1.7, 0.5]], "<f4")
        (folder / "velodyne_points" / "data" / f"{k:010d}.bin").write_bytes(rows.tobytes())
        (folder / "oxts" / "data" / f"{k:010d}.txt").write_text(oxts(k), encoding="utf-8")
    colour = P1.replace("-3.5", "-2.1")
    lines = ["calib_time: 09-Jan-2012 13:57:47"]
    for k, P in enumerate((P0, P1, P0, colour)):
        K = " ".join(map(str, np.array(P.split(), float).reshape(3, 4)[:, :3].ravel()))
        lines += [f"S_0{k}: 8 6", f"K_0{k}: {K}", f"R_0{k}:{_NO_ROTATION[2:]}", f"T_0{k}: 0 0 0"]
        lines += [f"R_rect_0{k}:{_NO_ROTATION[2:]}", f"S_rect_0{k}: 8 6", f"P_rect_0{k}: {P}"]
    (folder.parent / "calib_cam_to_cam.txt").write_text("\n".join(lines), encoding="utf-8")
    (folder.parent / "calib_imu_to_velo.txt").write_text(
        f"{_NO_ROTATION}\nT: -0.8 0.3 -0.8", encoding="utf-8"
    )
    (folder.parent / "calib_velo_to_cam.txt").write_text(f"{_NO_ROTATION}\nT: 0 0 -0.3", encoding="utf-8")
    return folder


def test_all_sensors_are_streams_with_their_own_times(tmp_path: Path) -> None:
    log = open_log(drive(tmp_path / "drive_0001_sync", "image_00", "image_01", "image_02", "image_03"))
    colour = {"/kitti/colour_left.frame", "/kitti/colour_right.frame"}
    assert set(log.streams) == {PAIR, TRUTH, IMU, SCAN, MOUNT, *colour}
    assert {info.count for name, info in log.streams.items() if name != MOUNT} == {3}
    samples = list(log.samples())
    assert samples[0].stamp_ns == START_NS
    assert samples[-1].stamp_ns == START_NS + 200_000_000
    pair = next(s.value for s in samples if s.stream == PAIR)
    assert pair.baseline == pytest.approx(0.5)
    place = pair.left.extrinsic.pose_robot_frame_sensor_frame
    np.testing.assert_allclose(place.transform.matrix[:3, 3], [0.8, -0.3, 1.1], atol=1e-9)
    mount = next(s.value for s in samples if s.stream == MOUNT)
    assert (mount.parent_frame, mount.child_frame) == ("kitti/base", "kitti/lidar")
    np.testing.assert_allclose(mount.transform.matrix[:3, 3], [0.8, -0.3, 0.8], atol=1e-9)
    imu = next(s.value for s in samples if s.stream == IMU)
    np.testing.assert_allclose(imu.acc, [0.1, 0.2, 9.8])
    np.testing.assert_allclose(imu.gyro, [0.01, 0.02, 0.03])


def test_truth_is_the_navigation_system_in_east_north_up(tmp_path: Path) -> None:
    samples = list(open_log(drive(tmp_path / "drive")).samples([TRUTH]))
    T = samples[2].value.transform.matrix
    np.testing.assert_allclose(T[:3, 3], [0.0, np.radians(2e-5) * 6_378_137.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(T[:2, 0], [np.cos(0.2), np.sin(0.2)], atol=1e-9)
    np.testing.assert_allclose(samples[0].value.transform.matrix, np.eye(4), atol=1e-9)


def test_colour_cameras_alone_are_the_pairs_and_the_folder_of_a_day_is_enough(tmp_path: Path) -> None:
    drive(tmp_path / "day" / "drive", "image_02", "image_03")
    log = open_log(tmp_path / "day")
    assert next(log.samples([PAIR])).value.baseline == pytest.approx(0.3)


def test_missing_files_keep_the_times_of_the_others(tmp_path: Path) -> None:
    folder = drive(tmp_path / "drive", "image_00", "image_01")
    (folder / "velodyne_points" / "data" / "0000000001.bin").unlink()
    (folder / "image_01" / "data" / "0000000000.png").unlink()
    log = open_log(folder)
    assert [s.stamp_ns - START_NS for s in log.samples([SCAN])] == [0, 200_000_000]
    assert [s.stamp_ns - START_NS for s in log.samples([PAIR])] == [100_000_000, 200_000_000]
    assert log.unconverted["single images of image_00"].count == 1


def test_malformed_files_are_named(tmp_path: Path) -> None:
    folder = drive(tmp_path / "drive", "image_00", "image_01")
    (folder / "oxts" / "data" / "0000000001.txt").write_text("49.0 8.4 nan", encoding="utf-8")
    with pytest.raises(InputError, match=r"0000000001\.txt"):
        list(open_log(folder).samples([TRUTH]))
    (folder / "oxts" / "timestamps.txt").write_text("2011-09-26\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"timestamps\.txt:1"):
        open_log(folder)
    (folder.parent / "calib_cam_to_cam.txt").unlink()
    stamps(folder / "oxts", 3)
    with pytest.raises(InputError, match=r"calib_cam_to_cam\.txt not found"):
        open_log(folder)


def test_colour_images_next_to_grey_ones_of_the_odometry_benchmark_are_streams(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    (folder / "image_2").mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / "image_2" / f"{k:06d}.png"), np.full((6, 8, 3), 7, np.uint8))
    assert open_log(folder).streams["/kitti/colour_left.frame"].count == 3


def test_colour_cameras_with_a_small_offset_in_y_are_rectified(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06", "image_2", "image_3")
    right = P1.replace("7.0e+00 2.8 0 ", "7.0e+00 2.8 0.0175 ")
    (folder / "calib.txt").write_text(f"P2: {P0}\nP3: {right}\n", encoding="utf-8")
    assert next(open_log(folder).samples([PAIR])).value.baseline == pytest.approx(0.5, rel=1e-3)
