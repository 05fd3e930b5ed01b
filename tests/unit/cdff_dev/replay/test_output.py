# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of a replay: trajectories and tracks."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from cdff_common.interfaces.product import Header, Product, Quality, Status
from cdff_common.types import ObjectTrack
from cdff_dev.replay.output import ReplayOutput


def _product(port: str, stamps_ns: list[int], status: Status = Status.OK) -> Product:
    poses = np.repeat(np.eye(4)[None], len(stamps_ns), axis=0)
    track = ObjectTrack.from_arrays(1, stamps_ns, poses, frame="servicer/camera")
    header = Header(
        id="",
        seq=0,
        t0_ns=stamps_ns[0],
        t1_ns=stamps_ns[0],
        frame="servicer/camera",
        producer="servicer/tracking",
        config_hash="0" * 8,
        quality=Quality(status=status),
    )
    return Product(
        robot="servicer",
        dfpc="tracking",
        port=port,
        product="track",
        type_name="ObjectTrack",
        header=header,
        value=track,
    )


def _column(path: Path, name: str) -> list[str]:
    with path.open() as file:
        return [row[name] for row in csv.DictReader(file)]


def test_states_of_a_track_are_rows_with_their_status_and_of_a_prediction_only_the_last_is_written(
    tmp_path: Path,
) -> None:
    output = ReplayOutput(tmp_path)
    output.write([_product("track", [1_000_000]), _product("prediction", [2_000_000, 3_000_000])])
    output.write([_product("track", [2_000_000], Status.DEGRADED)])
    output.write([_product("prediction", [4_000_000, 5_000_000])])
    output.close()
    output.write_summary({})
    assert _column(tmp_path / "track.csv", "stamp_ns") == ["1000000", "2000000"]
    assert _column(tmp_path / "track.csv", "status") == ["OK", "DEGRADED"]
    assert _column(tmp_path / "prediction.csv", "stamp_ns") == ["4000000", "5000000"]
