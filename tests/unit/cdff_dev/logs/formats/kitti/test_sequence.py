# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""KITTI folders are read as logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.description import Port
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.kitti.sequence import PAIR, SCAN, TRUTH, is_kitti, kitti_log
from cdff_dev.run.inputs import read_inputs

P0 = "7.0e+00 0 4.5 0 0 7.0e+00 2.8 0 0 0 1 0"
P1 = "7.0e+00 0 4.5 -3.5e+00 0 7.0e+00 2.8 0 0 0 1 0"


def sequence(folder: Path, left: str = "image_0", right: str = "image_1", n: int = 3) -> Path:
    for k, name in enumerate((left, right)):
        (folder / name).mkdir(parents=True)
        for i in range(n):
            cv2.imwrite(str(folder / name / f"{i:06d}.png"), np.full((6, 8), 10 * i + k, dtype=np.uint8))
    (folder / "calib.txt").write_text(f"P0: {P0}\nP1: {P1}\n", encoding="utf-8")
    return folder


def baseline_m(*arguments: Path) -> float:
    """Return the baseline of the first pair."""
    return float(next(kitti_log(*arguments).samples([PAIR])).value.baseline)


def test_pairs_carry_images_calibration_and_stamps(tmp_path: Path) -> None:
    log = kitti_log(sequence(tmp_path / "06"))
    samples = list(log.samples())
    assert [s.stream for s in samples] == [PAIR] * 3
    assert [s.stamp_ns for s in samples] == [0, 100_000_000, 200_000_000]
    pair = samples[2].value
    assert (pair.left.image[0, 0], pair.right.image[0, 0]) == (20, 21)
    assert pair.baseline == pytest.approx(0.5)
    np.testing.assert_allclose(pair.left.camera_matrix, [[7, 0, 4.5], [0, 7, 2.8], [0, 0, 1]])
    assert samples[1].header is not None
    assert samples[1].header.frame == "kitti/navcam_left"


def test_times_and_true_poses_are_read_if_their_files_exist(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    (folder / "times.txt").write_text("0.0\n1.036224e-01\n2.072e-01\n", encoding="utf-8")
    rows = ["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 0.1 0 1 0 0.2 0 0 1 1.2", "1 0 0 0.2 0 1 0 0.4 0 0 1 2.4"]
    (folder / "poses.txt").write_text("\n".join(rows), encoding="utf-8")
    log = kitti_log(folder)
    truth = list(log.samples([TRUTH]))
    assert [s.stamp_ns for s in truth] == [0, 103_622_000, 207_200_000]
    np.testing.assert_allclose(
        truth[1].value.transform.matrix, se3.transform(np.eye(3), [0.1, 0.2, 1.2]), atol=1e-12
    )
    assert (truth[1].value.parent_frame, truth[1].value.child_frame) == ("kitti/vo", "kitti/navcam_left")


def test_the_calibration_of_an_extract_precedes_that_of_its_parent_folder(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "x", "image_l_kitti", "image_r_kitti")
    (folder / "calib_kitti.txt").write_text(f"{P0}\n{P1.replace('-3.5', '-1.4')}\n", encoding="utf-8")
    assert baseline_m(folder) == pytest.approx(0.2)


@pytest.mark.parametrize(("left", "right"), [("image_2", "image_3"), ("image_l", "image_r")])
def test_colour_cameras_and_extracts_are_read(tmp_path: Path, left: str, right: str) -> None:
    folder = sequence(tmp_path / "06", left, right)
    assert baseline_m(folder) == pytest.approx(0.5)
    lines = [f"P0: {P0}", f"P1: {P1}", f"P2: {P0}", f"P3: {P1.replace('-3.5', '-2.1')}"]
    (folder / "calib.txt").write_text("\n".join(lines), encoding="utf-8")
    assert baseline_m(folder) == pytest.approx(0.3 if left == "image_2" else 0.5)


@pytest.mark.parametrize("place", ["sequences/06/poses/06.txt", "poses/06.txt"])
def test_poses_of_the_benchmark_are_found_by_the_number_of_the_sequence(tmp_path: Path, place: str) -> None:
    folder = sequence(tmp_path / "sequences" / "06")
    path = tmp_path / place
    path.parent.mkdir(exist_ok=True)
    path.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3, encoding="utf-8")
    assert kitti_log(folder).streams[TRUTH].count == 3


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        (" 4.5 ", " 600 ", "principal point 600.0, 2.8 in images of 8 x 6"),
        (" 4.5 ", " 5.7 ", "within 20% of the size"),
        (" 2.8 ", " 1.7 ", "principal point 4.5, 1.7"),
        ("7.0e+00 0 4.5", "1.5e+00 0 4.5", "focal length 1.5"),
        ("7.0e+00 0 4.5", "8.1e+01 0 4.5", "focal length 81.0"),
    ],
)
def test_a_calibration_that_does_not_fit_the_images_is_refused(
    tmp_path: Path, wrong: str, right: str, message: str
) -> None:
    folder = sequence(tmp_path / "06")
    text = (folder / "calib.txt").read_text(encoding="utf-8").replace(wrong, right)
    (folder / "calib.txt").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        kitti_log(folder)


def test_a_calibration_of_the_command_line_precedes_those_of_the_folder(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    mine = tmp_path / "mine.txt"
    mine.write_text(f"{P0}\n{P1.replace('-3.5', '-2.8')}\n", encoding="utf-8")
    assert baseline_m(folder, mine) == pytest.approx(0.4)
    pair = Port(name="pair", type="FramePair")
    value = read_inputs([pair], {"pair": f"{folder},{mine}"})["pair"]
    assert value.baseline == pytest.approx(0.4)
    with pytest.raises(InputError, match="--calibration"):
        open_log(folder, tmp_path / "missing.txt")
    (tmp_path / "log.msg").write_bytes(b"")
    with pytest.raises(InputError, match="its own cameras"):
        open_log(tmp_path / "log.msg", mine)


def scans(folder: Path, *numbers: int) -> None:
    (folder / "velodyne").mkdir(parents=True)
    for number in numbers:
        rows = np.array([[5.0, 0.1 * number, -1.7, 0.5], [3.0, 4.0, 0.5, 1.0]], "<f4")
        (folder / "velodyne" / f"{number:06d}.bin").write_bytes(rows.tobytes())


def test_scans_are_read_with_the_stamps_of_the_images_of_their_number(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    scans(folder, 0, 2)
    log = open_log(folder)
    assert log.streams[SCAN].count == 2
    assert [(s.stream, s.stamp_ns) for s in log.samples([PAIR, SCAN])] == [
        (SCAN, 0),
        (PAIR, 0),
        (PAIR, 100_000_000),
        (SCAN, 200_000_000),
        (PAIR, 200_000_000),
    ]
    sample = list(log.samples([SCAN]))[1]
    np.testing.assert_allclose(sample.value.points_m[0], [5.0, 0.2, -1.7], atol=1e-6)
    assert sample.header is not None
    assert sample.value.frame == sample.header.frame == "kitti/lidar"


def test_the_pose_of_the_lidar_in_the_left_camera_is_that_of_the_calibration(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    scans(folder, 0, 2)
    with (folder / "calib.txt").open("a", encoding="utf-8") as file:
        file.write("\nTr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n")
    (sample,) = open_log(folder).samples(["/kitti/lidar.mount"])
    assert (sample.value.parent_frame, sample.value.child_frame) == ("kitti/navcam_left", "kitti/lidar")
    ahead = sample.value.transform.matrix @ [1.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(ahead[:3], [0.1, -0.2, 0.7], atol=1e-9)


def test_a_folder_of_scans_needs_neither_images_nor_a_calibration(tmp_path: Path) -> None:
    scans(tmp_path / "06", 4, 5)
    log = open_log(tmp_path / "06")
    assert list(log.streams) == [SCAN]
    assert [s.stamp_ns for s in log.samples()] == [400_000_000, 500_000_000]
    with pytest.raises(InputError, match="no images for the calibration"):
        kitti_log(tmp_path / "06", tmp_path / "calib.txt")


def test_a_file_that_is_not_a_scan_is_reported_when_it_is_read(tmp_path: Path) -> None:
    scans(tmp_path / "06", 0)
    (tmp_path / "06" / "velodyne" / "000000.bin").write_bytes(b"text")
    with pytest.raises(CodecError, match=r"000000\.bin"):
        list(open_log(tmp_path / "06").samples())


def test_open_log_recognises_a_kitti_folder(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    assert is_kitti(folder)
    assert open_log(folder).streams[PAIR].count == 3
    assert not is_kitti(tmp_path)


def test_inconsistent_folders_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="image_0"):
        kitti_log(tmp_path)
    folder = sequence(tmp_path / "06")
    (folder / "image_1" / "000002.png").unlink()
    with pytest.raises(InputError, match="3 images in image_0, 2 in image_1"):
        kitti_log(folder)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("calib.txt", f"P0: {P0}\n", "expected two"),
        ("calib.txt", f"P0: {P1}\nP1: {P0}\n", "expected a rectified pair"),
        ("calib.txt", "P0: 1 2 3\n", "size 3"),
        ("times.txt", "0.0\n0.1\n0.1\n", "ascending"),
        ("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n", "1 poses for 3 images or scans"),
        ("poses.txt", "1 0 0 zero 0 1 0 0 0 0 1 0\n", "zero"),
    ],
)
def test_malformed_calibration_time_and_pose_files_are_refused(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    folder = sequence(tmp_path / "06")
    (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        kitti_log(folder)


def test_a_corrupt_image_is_left_out_and_listed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = sequence(tmp_path / "06")
    (folder / "image_0" / "000001.png").write_bytes(b"not a png")
    log = kitti_log(folder)
    numbers = [sample.seq for sample in log.samples([PAIR])]
    assert numbers == [n for n in range(log.streams[PAIR].count) if n != 1]
    assert "000001.png" in caplog.text
    (item,) = (item for name, item in log.unconverted.items() if "damaged" in name)
    assert item.count == 1
    assert "000001.png" in item.reason


def test_a_sequence_without_a_readable_image_is_refused(tmp_path: Path) -> None:
    folder = sequence(tmp_path / "06")
    for image in (folder / "image_0").iterdir():
        image.write_bytes(b"not a png")
    with pytest.raises(CodecError, match=r"000000\.png"):
        list(kitti_log(folder).samples([PAIR]))


def test_the_recorded_sequence_has_its_length_baseline_and_path_length(
    real_data: Callable[[str], Path],
) -> None:
    log = kitti_log(real_data("kitti_stereo/KITTI_sequence_1"))
    assert log.streams[PAIR].count == log.streams[TRUTH].count == 51
    assert next(log.samples([PAIR])).value.baseline == pytest.approx(0.537, abs=1e-3)
    poses = np.array([s.value.transform.matrix for s in log.samples([TRUTH])])
    path_length_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()
    assert path_length_m == pytest.approx(59.9, abs=0.2)
