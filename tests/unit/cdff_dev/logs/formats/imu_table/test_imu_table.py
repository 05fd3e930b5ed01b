# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CSV files of an inertial measurement unit are read as logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log

EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
ROS = (
    "time,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,"
    "angular_velocity.x,angular_velocity.y,angular_velocity.z"
)


def _table(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("lines", "stamps_ns"),
    [
        ([EUROC, "1600000000000000000,1,2,3,4,5,6"], [1_600_000_000_000_000_000]),
        ([ROS, "0.5,4,5,6,1,2,3", "", "0.6,4,5,6,1,2,3"], [500_000_000, 600_000_000]),
        (["t,ax,ay,az,gx,gy,gz,temperature", "2.0,4,5,6,1,2,3,20"], [2_000_000_000]),
    ],
)
def test_usual_names_of_columns_are_recognised(
    lines: list[str], stamps_ns: list[int], tmp_path: Path
) -> None:
    log = open_log(_table(tmp_path / "xsens.csv", *lines))
    samples = list(log.samples(["/xsens/imu.imu"]))
    assert [sample.stamp_ns for sample in samples] == stamps_ns
    np.testing.assert_array_equal(samples[0].value.acc, [4.0, 5.0, 6.0])
    np.testing.assert_array_equal(samples[0].value.gyro, [1.0, 2.0, 3.0])
    assert set(log.unconverted) == ({"temperature"} if "temperature" in lines[0] else set())


def test_units_in_the_names_are_converted(tmp_path: Path) -> None:
    names = "time,acc_x [g],acc_y [g],acc_z [g],gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)"
    (sample,) = open_log(_table(tmp_path / "imu.csv", names, "0.1,0,0,1,0,0,180")).samples()
    np.testing.assert_allclose(sample.value.acc, [0.0, 0.0, 9.80665])
    np.testing.assert_allclose(sample.value.gyro, [0.0, 0.0, np.pi])


@pytest.mark.parametrize("line", ["0.2,1,2,3,4,5,fast", "0.2,1,2", "0.2,1,2,3,4,5,nan", "never,1,2,3,4,5,6"])
def test_a_damaged_line_is_named(line: str, tmp_path: Path) -> None:
    path = _table(tmp_path / "imu.csv", ROS, "0.1,1,2,3,4,5,6", line)
    with pytest.raises(InputError, match=r"imu\.csv:3"):
        open_log(path)


def test_a_table_without_rates_is_none_of_an_imu(tmp_path: Path) -> None:
    path = _table(tmp_path / "acc.csv", "t,ax,ay,az", "0.1,1,2,3")
    with pytest.raises(InputError, match="table with t, ax, ay, az"):
        open_log(path)
