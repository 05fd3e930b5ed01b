# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""NPZ, numpy's archive of named arrays; nothing in it is ever unpickled."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.formats.source import LIMIT_BYTES, Readable, load


def read_npz(source: Readable) -> dict[str, NDArray[Any]]:
    """Arrays by name; raises CodecError naming the file on anything else, or on more than 4 GiB unpacked."""
    s = load(source)
    try:
        with zipfile.ZipFile(io.BytesIO(s.data)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > LIMIT_BYTES:
            raise s.error(f"{size} bytes unpacked, expected at most {LIMIT_BYTES}")
        with np.load(io.BytesIO(s.data), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile, KeyError, EOFError) as error:
        raise s.error(f"no readable npz: {error}") from error


def write_npz(arrays: Mapping[str, ArrayLike]) -> bytes:
    """Bytes of a compressed archive; the same arrays give the same bytes (no times inside)."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, value in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")  # its default date is fixed: 1980
            entry.compress_type = zipfile.ZIP_DEFLATED
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(value), allow_pickle=False)
            archive.writestr(entry, member.getvalue())
    return out.getvalue()
