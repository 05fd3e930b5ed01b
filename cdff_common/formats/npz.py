# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""NPZ, numpy's archive of named arrays; nothing in it is ever unpickled."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.formats.source import Readable, Source, load


def read_npz(source: Readable) -> dict[str, NDArray[Any]]:
    """Arrays by name; raises CodecError naming the file on anything else, or where it claims too much."""
    s = load(source)
    try:
        with zipfile.ZipFile(io.BytesIO(s.data)) as archive:
            _check_claims(s, archive)
        with np.load(io.BytesIO(s.data), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile, KeyError, EOFError) as error:
        raise s.error(f"no readable npz: {error}") from error


def _check_claims(s: Source, archive: zipfile.ZipFile) -> None:
    """Compare the sizes that the archive and the headers of its arrays claim, before an array is made for them."""
    entries = archive.infolist()
    s.check_claim(sum(entry.file_size for entry in entries), f"{len(entries)} members")
    for entry in entries:
        with archive.open(entry) as member:
            version = np.lib.format.read_magic(member)
            read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
            if version not in read:
                raise s.error(f"{entry.filename}: npy version {version}, expected 1.0 or 2.0")
            shape, _, dtype = read[version](member)
        claimed = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or claimed > entry.file_size:
            raise s.error(f"{entry.filename}: shape {shape} of {dtype}, more than its {entry.file_size} bytes")


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
