# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation maps from files of several kinds."""

from __future__ import annotations

from pathlib import Path

from cdff_common.errors import InputError
from cdff_common.formats.geotiff import read_map
from cdff_common.types import ElevationMap
from cdff_dev.logs import open_log


def read_dem(path: str, stream: str | None = None, frame: str | None = None) -> ElevationMap:
    """Read an elevation map.

    Parameters
    ----------
    path : str
        A GeoTIFF (a foreign one of a single band is that of heights), or a log, of which the last map is taken.
    stream : str, optional
        Stream of a log with elevation maps in several.
    frame : str, optional
        Frame of a GeoTIFF that names none.

    Raises
    ------
    InputError
        If there is no such file, or no map in it.
    """
    place = Path(path)
    if place.suffix.lower() in (".tif", ".tiff"):
        if not place.is_file():
            raise InputError(f"{path}: no such file")
        made = read_map(place, "ElevationMap", frame=frame)
        assert isinstance(made, ElevationMap)
        return made
    with open_log(place) as log:
        found = [name for name, info in log.streams.items() if info.type_name == "ElevationMap"]
        if stream is not None and stream not in found:
            raise InputError(f"{path}: no elevation maps in {stream!r}; they are in {', '.join(found) or 'none'}")
        if stream is None and len(found) != 1:
            raise InputError(f"{path}: elevation maps in {', '.join(found) or 'no stream'}: name one stream")
        last: ElevationMap | None = None
        for sample in log.samples([stream or found[0]]):
            last = sample.value
    if last is None:
        raise InputError(f"{path}: {stream or found[0]} holds no map")
    return last
