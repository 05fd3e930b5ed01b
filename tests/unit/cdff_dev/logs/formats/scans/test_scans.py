# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files with one lidar scan each are read as a log."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.pcd import write_pcd
from cdff_common.formats.ply import write_ply
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.scans.scans import SCAN

POINTS_M = np.array([[5.0, 1.0, -1.7], [3.0, 4.0, 0.5]])


def bin_scan(path: Path) -> None:
    rows = np.column_stack([POINTS_M, [0.5, 1.0]]).astype("<f4")
    path.write_bytes(rows.tobytes())


def ply_scan(path: Path) -> None:
    path.write_bytes(write_ply(CloudArrays.of([*POINTS_M, [np.nan, 0.0, 0.0]], [10.0, 255.0, 0.0])))


def test_a_folder_of_bin_files_has_the_times_of_their_numbers(tmp_path: Path) -> None:
    for number in (4, 6):
        bin_scan(tmp_path / f"{number:06d}.bin")
    samples = list(open_log(tmp_path).samples())
    assert [(s.stream, s.stamp_ns) for s in samples] == [(SCAN, 400_000_000), (SCAN, 600_000_000)]
    np.testing.assert_allclose(samples[0].value.points_m, POINTS_M, atol=1e-6)
    np.testing.assert_array_equal(samples[0].value.intensity, [32768, 65535])


def test_points_of_a_ply_file_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    for name in ("a_1600000000.5", "a_1600000001.25"):
        ply_scan(tmp_path / f"{name[2:]}.ply")
    samples = list(open_log(str(tmp_path / "*.ply")).samples())
    assert [s.stamp_ns for s in samples] == [1_600_000_000_500_000_000, 1_600_000_001_250_000_000]
    np.testing.assert_allclose(samples[0].value.points_m, POINTS_M)
    np.testing.assert_array_equal(samples[0].value.intensity, [2570, 65535])


@pytest.mark.parametrize(
    ("stems", "stamps_ns"),
    [
        (("scan", "scene"), (0, 100_000_000)),
        (
            ("s_1600000000123456", "s_1600000001123456"),
            (1_600_000_000_123_456_000, 1_600_000_001_123_456_000),
        ),
        (
            ("1600000000123456789", "1600000000223456789"),
            (1_600_000_000_123_457_000, 1_600_000_000_223_457_000),
        ),
    ],
)
def test_names_are_times_in_any_unit_or_an_order(
    tmp_path: Path, stems: tuple[str, str], stamps_ns: tuple[int, int]
) -> None:
    for stem in stems:
        bin_scan(tmp_path / f"{stem}.bin")
    assert tuple(s.stamp_ns for s in open_log(tmp_path).samples()) == stamps_ns


def test_times_of_a_file_precede_names(tmp_path: Path) -> None:
    for number in (1, 2):
        bin_scan(tmp_path / f"{number}.bin")
    (tmp_path / "times.txt").write_text("0.0\n0.25\n", encoding="utf-8")
    assert [s.stamp_ns for s in open_log(tmp_path).samples()] == [0, 250_000_000]
    (tmp_path / "times.txt").write_text("0.5\n0.5\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"times\.txt: the time of number 1 is not after"):
        open_log(tmp_path)
    (tmp_path / "times.txt").write_text("0.5\n", encoding="utf-8")
    with pytest.raises(InputError, match="1 times for 2 files"):
        open_log(tmp_path)


def test_a_file_that_is_not_a_cloud_is_left_out_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bin_scan(tmp_path / "000000.bin")
    (tmp_path / "000001.bin").write_bytes(b"text")
    with open_log(tmp_path) as log:
        assert [sample.seq for sample in log.samples()] == [0]
    assert "000001.bin" in caplog.text
    with pytest.raises(CodecError, match=r"000001\.bin"):
        list(open_log(tmp_path / "000001.bin").samples())


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cut.ply", write_ply(CloudArrays.of(np.tile(POINTS_M, (5, 1))))),
        ("cut.ply", write_ply(CloudArrays.of(np.tile(POINTS_M, (5, 1))), ascii_text=True)),
        ("cut.pcd", write_pcd(CloudArrays.of(np.tile(POINTS_M, (5, 1))))),
        ("cut.pcd", write_pcd(CloudArrays.of(np.tile(POINTS_M, (5, 1))), layout="ascii")),
    ],
)
def test_a_cut_cloud_has_the_points_before_its_end(
    tmp_path: Path, name: str, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    for cut in (9, 20, 40):
        path = tmp_path / name
        path.write_bytes(content[:-cut])
        caplog.clear()
        with open_log(path) as log:
            (sample,) = log.samples()
        count = len(sample.value.points_m)
        assert 2 <= count < 10
        np.testing.assert_allclose(sample.value.points_m, np.tile(POINTS_M, (5, 1))[:count], atol=1e-6)
        (record,) = caplog.records
        assert f"{name}: ends at byte {len(content) - cut} after {count} of 10" in record.message
    header = next(mark for mark in (b"end_header", b"DATA") if mark in content)
    path.write_bytes(content[: content.index(b"\n", content.index(header)) + 5])
    with pytest.raises(CodecError, match=name), open_log(path) as log:
        list(log.samples())


def test_a_scan_that_was_cut_within_a_point_has_the_others(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bin_scan(tmp_path / "000000.bin")
    content = (tmp_path / "000000.bin").read_bytes()
    (tmp_path / "000000.bin").write_bytes(content[:-7])
    (sample,) = open_log(tmp_path / "000000.bin").samples()
    assert len(sample.value.points_m) == len(content) // 16 - 1
    assert "within a point" in caplog.text


def test_the_shared_folder_of_scans_opens_by_its_path(real_data: Callable[[str], Path]) -> None:
    log = open_log(real_data("kitti_velodyne"))
    assert log.streams[SCAN].count == 5
    assert len(next(log.samples()).value.points_m) > 120_000


def test_a_path_that_no_format_recognises_names_the_known_formats(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello", encoding="utf-8")
    with pytest.raises(InputError, match=r"begins with b'hello'.*ROS bag"):
        open_log(tmp_path / "notes.txt")
    with pytest.raises(InputError, match="no such file"):
        open_log(tmp_path / "nothing*.bag")


@pytest.mark.parametrize("suffix", ["xyz", "txt", "npy", "e57"])
def test_text_arrays_and_e57_are_scans(tmp_path: Path, suffix: str) -> None:
    for number in (1, 2):
        path = tmp_path / f"{number}.{suffix}"
        if suffix == "npy":
            np.save(path, np.column_stack([POINTS_M, [10.0, 20.0]]))
        elif suffix == "e57":
            pye57 = pytest.importorskip("pye57")
            with pye57.E57(str(path), mode="w") as file:
                axes = {f"cartesian{a}": POINTS_M[:, i].copy() for i, a in enumerate("XYZ")}
                file.write_scan_raw(axes, translation=np.array([0.0, 0.0, 1.0]))
        else:
            path.write_text("x,y,z\n" + "\n".join(f"{x}, {y}, {z}" for x, y, z in POINTS_M), encoding="utf-8")
    (tmp_path / "readme.md").write_text("two scans", encoding="utf-8")
    samples = list(open_log(tmp_path).samples())
    assert [s.stamp_ns for s in samples] == [100_000_000, 200_000_000]
    offset = [0.0, 0.0, 1.0] if suffix == "e57" else [0.0, 0.0, 0.0]
    np.testing.assert_allclose(samples[0].value.points_m, POINTS_M + np.array(offset), atol=1e-6)


def test_pickled_arrays_and_other_texts_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "1.npy", np.array([{}, {}], dtype=object), allow_pickle=True)
    with pytest.raises(CodecError, match=r"1\.npy"):
        list(open_log(tmp_path / "1.npy").samples())
    (tmp_path / "2.xyz").write_text("1 2 3\n4 5\n" * 2000, encoding="utf-8")
    with pytest.raises(InputError, match="none of the known formats"):
        open_log(tmp_path / "2.xyz")
    (tmp_path / "3.xyz").write_text("1 2 3\n" * 2000 + "4 five 6\n", encoding="utf-8")
    with pytest.raises(CodecError, match=r"3\.xyz: line 2001"):
        list(open_log(tmp_path / "3.xyz").samples())
    (tmp_path / "4.e57").write_bytes(b"ASTM-E57" + bytes(100))
    with pytest.raises(CodecError, match=r"4\.e57"):
        list(open_log(tmp_path / "4.e57").samples())
