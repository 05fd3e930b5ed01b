# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compressed payload files."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
import zstandard

from cdff_common.errors import CodecError
from dpm_store.payloads.seekable import compress, read_frames

FRAME = 1000
CONTENT = np.random.default_rng(1).integers(0, 3, 3 * FRAME + 1, np.uint8).tobytes()


def read(data: bytes, first: int, last: int) -> bytes:
    return read_frames(io.BytesIO(data), len(data), len(CONTENT), first, last)


@pytest.mark.parametrize(("first", "last"), [(0, 4), (0, 1), (1, 3), (3, 4)])
def test_frames_are_read_without_the_others(first: int, last: int) -> None:
    assert read(compress(CONTENT, FRAME), first, last) == CONTENT[first * FRAME : last * FRAME]


def test_other_programs_read_the_file() -> None:
    """The table is in a skippable frame."""
    data = compress(CONTENT, FRAME)
    reader = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
    assert reader.readall() == CONTENT


def test_damage_never_gives_more_bytes_than_expected() -> None:
    """A changed byte of the content is not detected here, but by the checksum of the payload."""
    data, rng = compress(CONTENT, FRAME), np.random.default_rng(2)
    refused = 0
    for _ in range(2000):
        damaged = bytearray(data)
        for position in rng.integers(0, len(data), rng.integers(1, 4)):
            damaged[position] = rng.integers(0, 256)
        if rng.random() < 0.2:
            del damaged[int(rng.integers(0, len(data))) :]
        try:
            assert len(read(bytes(damaged), 0, 4)) <= len(CONTENT)
        except CodecError:
            refused += 1
    assert refused > 500


def test_a_frame_that_states_a_huge_content_is_refused() -> None:
    frame = zstandard.ZstdCompressor().compress(bytes(1 << 24))
    table = struct.pack("<II", len(frame), len(CONTENT)) + struct.pack("<IBI", 1, 0, 0x8F92EAB1)
    data = frame + struct.pack("<II", 0x184D2A5E, len(table)) + table
    with pytest.raises(CodecError, match="16777216 bytes of content, expected 3001"):
        read(data, 0, 1)
    with pytest.raises(CodecError, match="1 compressed frames: expected 4 or more"):
        read(data, 0, 4)
