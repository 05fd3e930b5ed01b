# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tracks of objects as CSV."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.formats.payload import to_file
from cdff_common.formats.track_csv import COLUMNS, write_track_csv
from cdff_common.geometry import se3
from cdff_common.types import ObjectTrack


def _rows(data: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(data.decode())))


def _track(**further: object) -> ObjectTrack:
    T = se3.transform(se3.exp_so3([0.0, 0.0, np.pi / 2]), [1.0, 2.0, 3.0])
    frame = "servicer/lvlh"
    return ObjectTrack.from_arrays(7, [5_000_000], T[None], frame=frame, **further)  # type: ignore[arg-type]


def test_a_row_has_pose_velocities_and_the_largest_standard_deviation_of_each_group() -> None:
    covariance = np.diag([0.01, 0.04, 0.09, 1e-4, 4e-4, 1e-4])
    track = _track(
        velocities=np.arange(1.0, 7.0)[None],
        covariances=covariance[None],
        velocity_covariances=4.0 * covariance[None],
    )
    (row,) = _rows(to_file(track, "csv"))
    assert tuple(row) == COLUMNS
    assert row["stamp_ns"] == "5000000"
    assert [float(row[name]) for name in ("x_m", "y_m", "z_m")] == [1.0, 2.0, 3.0]
    assert float(row["qz"]) == pytest.approx(np.sqrt(0.5))
    assert float(row["qw"]) == pytest.approx(np.sqrt(0.5))
    assert [float(row[name]) for name in COLUMNS[8:14]] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    sigmas = [float(row[name]) for name in COLUMNS[14:18]]
    assert sigmas == pytest.approx([0.3, 0.02, 0.6, 0.04])
    assert row["status"] == "TENTATIVE"


def test_values_that_a_track_does_not_state_are_empty() -> None:
    (row,) = _rows(write_track_csv([_track()], ["DEGRADED"]))
    assert row["status"] == "DEGRADED"
    assert {row[name] for name in COLUMNS[8:18]} == {""}


def test_tracks_and_statuses_of_different_number_are_refused() -> None:
    with pytest.raises(InputError, match="2 statuses for 1 tracks"):
        write_track_csv([_track()], ["OK", "OK"])


def test_a_track_without_states_is_a_header_only() -> None:
    track = ObjectTrack.from_arrays(1, np.zeros(0, np.int64), np.zeros((0, 4, 4)), frame="site")
    assert _rows(write_track_csv([track])) == []


def test_a_track_of_bearings_has_the_columns_of_bearings_and_no_number_without_a_range() -> None:
    track = ObjectTrack.from_bearing(
        7,
        5_000,
        frame="inertial",
        bearing=[1.0, 0.5, 1e-5, 1e-5, np.nan, np.nan],
        position_m=np.full(3, np.nan),
        position_covariance=np.full((3, 3), np.nan),
        velocity=np.zeros(3),
        pixel=[10.0, 20.0],
        pixel_sigma=[0.1, 0.2],
    )
    (row,) = _rows(to_file(track, "csv"))
    assert (row["stamp_ns"], row["id"], row["status"]) == ("5000", "7", "confirmed")
    assert (float(row["azimuth_rad"]), float(row["u_px"])) == (1.0, 10.0)
    assert row["range_m"] == row["sigma_range_m"] == ""
    content = json.loads(to_file(track, "json"))
    assert (content["frame"], content["label"]) == ("inertial", "")
    (values,) = content["states"]
    assert (values["stamp_ns"], values["range_m"], values["elevation_rad"]) == (5000, None, 0.5)
    (state,) = _rows(write_track_csv([track]))
    assert state["x_m"] == state["sigma_position_m"] == ""
