# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""NPY and NPZ, numpy's files of one array and of named arrays, without pickled objects."""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.formats.file_source import Readable, Source, load

#: Errors of numpy and zipfile for damaged content; a header of numpy is Python's text of a dictionary.
_ERRORS = (
    EOFError,
    LookupError,
    NotImplementedError,
    OSError,
    SyntaxError,
    TypeError,
    ValueError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


def read_npz(source: Readable) -> dict[str, NDArray[Any]]:
    """Return the arrays by name; raises CodecError on other files and implausible sizes."""
    s = load(source)
    try:
        with zipfile.ZipFile(io.BytesIO(s.data)) as archive:
            _check_claims(s, archive)
        with np.load(io.BytesIO(s.data), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except _ERRORS as error:
        raise s.error(f"not a readable npz: {error}") from error


def read_npy(source: Readable) -> NDArray[Any]:
    """Return the array of a npy file; raises CodecError on other files, objects, and implausible sizes."""
    s = load(source)
    try:
        _check_header(s, io.BytesIO(s.data), "its header", len(s.data))
        return np.asarray(np.load(io.BytesIO(s.data), allow_pickle=False))
    except _ERRORS as error:
        raise s.error(f"not a readable npy: {error}") from error


def _check_claims(s: Source, archive: zipfile.ZipFile) -> None:
    """Check the sizes stated in the archive and in the headers of its arrays, before any allocation."""
    entries = archive.infolist()
    s.check_claim(sum(entry.file_size for entry in entries), f"{len(entries)} members")
    for entry in entries:
        with archive.open(entry) as member:
            _check_header(s, member, entry.filename, entry.file_size)


def _check_header(s: Source, member: IO[bytes], name: str, size: int) -> None:
    """Check the size that the header of an array states."""
    version = np.lib.format.read_magic(member)
    header_readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in header_readers:
        raise s.error(f"{name}: npy version {version}, expected 1.0 or 2.0")
    shape, _, dtype = header_readers[version](member)
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize > size:
        raise s.error(f"{name}: shape {shape} of {dtype}, more than its {size} bytes")


def write_npz(arrays: Mapping[str, ArrayLike]) -> bytes:
    """Return a compressed archive; equal arrays give equal bytes (it contains no times)."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, value in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")  # its default date is fixed: 1980
            entry.compress_type = zipfile.ZIP_DEFLATED
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(value), allow_pickle=False)
            archive.writestr(entry, member.getvalue())
    return out.getvalue()
