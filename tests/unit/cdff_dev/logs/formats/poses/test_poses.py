# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of poses are logs with one stream."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import CodecError
from cdff_dev.compare.trajectory.read import read_track
from cdff_dev.logs import open_log

NAME = "/robot/truth.pose"
KITTI = "1 0 0 2 0 1 0 3 0 0 1 4\n"
MATRIX = [f"T{row}{col}" for row in range(3) for col in range(4)]
IMAGES = "image,qw,qx,qy,qz,tx_km,ty_km,tz_km\n"


@pytest.mark.parametrize(
    ("name", "text", "stamps_ns", "first_m"),
    [
        (
            "a.tum",
            "# stamp\n1.5 2 3 4 0 0 0 1\n2.5 3 3 4 0 0 0 1\n",
            [1_500_000_000, 2_500_000_000],
            [2, 3, 4],
        ),
        ("poses.txt", 2 * KITTI, [0, 100_000_000], [2, 3, 4]),
        (
            "a.csv",
            "t_ns,x,y,z,qx,qy,qz,qw\n1000,2,3,4,0,0,0,1\n5000,2,3,4,0,0,0,1\n",
            [1000, 5000],
            [2, 3, 4],
        ),
        (
            "truth.csv",
            IMAGES
            + "CAM1_20140805T200719.png,1,0,0,0,.002,.003,.004\nCAM1_20140805T200720.png,1,0,0,0,0,0,0\n",
            [1_407_269_239_000_000_000, 1_407_269_240_000_000_000],
            [2, 3, 4],
        ),
        (
            "truth.csv",
            f"frame,{','.join(MATRIX)}\n7,{KITTI.strip().replace(' ', ',')}\n",
            [700_000_000],
            [2, 3, 4],
        ),
    ],
)
def test_a_file_of_poses_is_a_stream(
    tmp_path: Path, name: str, text: str, stamps_ns: list[int], first_m: list[float]
) -> None:
    (tmp_path / name).write_text(text)
    with open_log(tmp_path / name) as log:
        samples = list(log.samples())
    assert [(s.stream, s.stamp_ns) for s in samples] == [(NAME, stamp_ns) for stamp_ns in stamps_ns]
    np.testing.assert_allclose(samples[0].value.transform.matrix[:3, 3], first_m)
    track = read_track(tmp_path / name)
    assert track.stamps_ns.tolist() == stamps_ns


@pytest.mark.parametrize(
    ("name", "times", "stamps_ns"),
    [
        (
            "timestamp",
            ["1403715273.262143", "1403715273.312"],
            [1_403_715_273_262_143_000, 1_403_715_273_312_000_000],
        ),
        (
            "timestamp",
            ["1403715273262142976", "1403715273312143104"],
            [1_403_715_273_262_142_976, 1_403_715_273_312_143_104],
        ),
        (
            "#timestamp [ns]",
            ["1403715273262142976.0", "1.403715273312e18"],
            [1_403_715_273_262_142_976, 1_403_715_273_312_000_000],
        ),
        ("timestamp", ["0.5", "12"], [500_000_000, 12_000_000_000]),
        ("time", ["0", "1"], [0, 1_000_000_000]),
        ("time", ["0", "5000000000"], [0, 5_000_000_000]),
        ("timestamp_ms", ["10", "20.5"], [10_000_000, 20_500_000]),
        ("t", ["1403715273262", "1403715273312"], [1_403_715_273_262_000_000, 1_403_715_273_312_000_000]),
        ("timestamp", ["1403715273", "1403715274"], [1_403_715_273_000_000_000, 1_403_715_274_000_000_000]),
    ],
)
def test_times_of_a_table_are_in_the_unit_of_their_name_or_size(
    tmp_path: Path, name: str, times: list[str], stamps_ns: list[int]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{name},x,y,z,qx,qy,qz,qw\n" + "".join(f"{time},2,3,4,0,0,0,1\n" for time in times))
    assert read_track(path).stamps_ns.tolist() == stamps_ns
    with open_log(path) as log:
        assert [s.stamp_ns for s in log.samples()] == [round(stamp / 1000) * 1000 for stamp in stamps_ns]


@pytest.mark.parametrize("time", ["nan", "inf", "1e400", "1e999999999", "9e30", "x", ""])
def test_an_impossible_time_of_a_table_is_refused_with_its_line(tmp_path: Path, time: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"timestamp,x,y,z,qx,qy,qz,qw\n1.5,2,3,4,0,0,0,1\n{time},2,3,4,0,0,0,1\n")
    with pytest.raises(CodecError, match=r"a\.csv: line 3"):
        open_log(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [(KITTI + "1 2 3\n", "12 numbers"), (KITTI + KITTI.replace("2", "nan"), "not finite")],
)
def test_a_malformed_line_of_a_file_of_poses_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(CodecError, match=message):
        open_log(tmp_path / "poses.txt")


def test_a_file_of_poses_that_was_cut_has_the_poses_before(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "poses.txt").write_text(KITTI * 3 + KITTI[:9])
    with open_log(tmp_path / "poses.txt") as log:
        assert len(list(log.samples())) == 3
    assert "ends in line 4" in caplog.text
