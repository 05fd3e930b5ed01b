# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""File formats that products can be asked in; those whose library is not installed here are left to the DPM."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cdff_common.errors import InputError, UnavailableError

#: Format -> media type of the reply.
MEDIA_TYPES = {"tif": "image/tiff", "ply": "application/x-ply", "tum": "text/plain", "png": "image/png"}


def file_bytes(value: Any, form: str) -> tuple[bytes, str]:
    """Return the bytes of a value in a file format, and its media type.

    Raises
    ------
    UnavailableError
        If the library that writes it is not installed here.
    InputError
        If the type has no such form.
    """
    writers: dict[str, Callable[[Any], bytes]] = {"tif": _tif, "ply": _ply, "tum": _tum, "png": _png}
    if form not in writers:
        raise InputError(f"format={form!r}: expected one of {', '.join(writers)}")
    try:
        return writers[form](value), MEDIA_TYPES[form]
    except ImportError as error:
        raise UnavailableError(
            f"format={form}: {error.name} is not installed in the orchestrator; ask deliver=reference"
        ) from error


def _tif(value: Any) -> bytes:
    from cdff_common.formats.geotiff import write_map  # rasterio, which not every image carries

    return write_map(value)


def _ply(value: Any) -> bytes:
    from cdff_common.formats.cloud import CloudArrays
    from cdff_common.formats.ply import write_ply

    return write_ply(CloudArrays.of(value.points_m, value.intensity), comments={"frame": value.frame})


def _tum(value: Any) -> bytes:
    from cdff_common.formats.tum import write_tum

    if hasattr(value, "matrices"):
        return write_tum(value.stamps_ns, value.matrices)
    return write_tum([value.stamp_ns], [value.transform.matrix])


def _png(value: Any) -> bytes:
    from cdff_common.formats.image import write_png

    return write_png(value.image)
