# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of elevation maps from GeoTIFF files and logs."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from cdff_common.errors import InputError
from cdff_common.formats.geotiff import read_map
from cdff_common.types import ElevationMap
from cdff_dev.logs import open_log
from cdff_dev.logs.source import only_stream


def read_dem(path: str, stream: str | None = None, frame: str | None = None) -> ElevationMap:
    """Read an elevation map.

    Parameters
    ----------
    path : str
        A GeoTIFF with the bands of the DPM or with one band of heights, or a log, of which the last map is
        used.
    stream : str, optional
        Stream to read, if a log has elevation maps in several.
    frame : str, optional
        Frame of the map, if the GeoTIFF does not contain the name of a frame.

    Raises
    ------
    InputError
        If there is no such file, or no map in it.
    """
    file = Path(path)
    if file.suffix.lower() in (".tif", ".tiff"):
        if not file.is_file():
            raise InputError(f"{path}: no such file")
        elevation_map = read_map(file, "ElevationMap", frame=frame)
        assert isinstance(elevation_map, ElevationMap)
        return elevation_map
    with closing(open_log(file)) as log:
        try:
            name = only_stream(log, ("ElevationMap",), stream, "elevation maps")
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        last_map: ElevationMap | None = None
        for sample in log.samples([name]):
            last_map = sample.value
    if last_map is None:
        raise InputError(f"{path}: {name} contains no map")
    return last_map
