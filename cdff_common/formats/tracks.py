# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Table of the states of tracked objects: direction, range where observable, and pixel."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING

import numpy as np

from cdff_common.types import ObjectTrackStatusT

if TYPE_CHECKING:
    from cdff_common.types import ObjectTrack

#: Columns of the table; numbers that are not observable are empty.
TRACK_COLUMNS = (
    "stamp_ns",
    "id",
    "u_px",
    "v_px",
    "sigma_u_px",
    "sigma_v_px",
    "azimuth_rad",
    "elevation_rad",
    "range_m",
    "sigma_range_m",
    "status",
)


def track_rows(track: ObjectTrack) -> list[str]:
    """Return one line per state with a bearing; the last one has the status of the track, others
    ``confirmed``.
    """
    data, rows = track.data, []
    count = len(data.bearings)
    for i in range(count):
        is_last = i == count - 1
        status = track.metadata.status if is_last else ObjectTrackStatusT.TRACK_CONFIRMED
        pixel = data.pixels[i] if len(data.pixels) else np.full(2, np.nan)
        sigma = data.pixel_sigmas[i] if len(data.pixel_sigmas) else np.full(2, np.nan)
        azimuth, elevation, _, _, range_m, range_sigma_m = data.bearings[i]
        numbers = (*pixel, *sigma, azimuth, elevation, range_m, range_sigma_m)
        formats = ("4f",) * 4 + ("9f",) * 2 + ("6g",) * 2
        texts = [f"{x:.{f}}" if np.isfinite(x) else "" for x, f in zip(numbers, formats, strict=True)]
        name = ObjectTrackStatusT(status).name.removeprefix("TRACK_").lower()
        rows.append(",".join([str(int(data.stamps[i]) * 1000), str(track.metadata.track_id), *texts, name]))
    return rows


def tracks_csv(track: ObjectTrack) -> bytes:
    """Return the table of one track."""
    return ("\n".join([",".join(TRACK_COLUMNS), *track_rows(track)]) + "\n").encode()


def track_json(track: ObjectTrack, table: bytes) -> bytes:
    """Return frame, label and states of a track in CSV as JSON; empty cells are null."""
    rows = csv.DictReader(io.StringIO(table.decode()))
    states = [{name: _json_value(name, text) for name, text in row.items()} for row in rows]
    return json.dumps(
        {"frame": track.metadata.frame_id, "label": track.metadata.label, "states": states}, indent=1
    ).encode()


def _json_value(name: str, text: str) -> int | float | str | None:
    if name == "status":
        return text
    if text == "":
        return None
    return int(text) if name in ("stamp_ns", "id") else float(text)
