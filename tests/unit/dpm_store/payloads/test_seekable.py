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


SUMS = bytes(range(16))
DATA = compress(CONTENT, FRAME, SUMS)


def read(data: bytes, first: int, last: int, sums: bytes = SUMS) -> tuple[bytes, bool]:
    return read_frames(io.BytesIO(data), len(data), len(CONTENT), first, last, sums)


def without_checksums() -> bytes:
    """Return a file as earlier versions wrote it."""
    parts = [CONTENT[i : i + FRAME] for i in range(0, len(CONTENT), FRAME)]
    frames = [zstandard.ZstdCompressor().compress(part) for part in parts]
    table = b"".join(struct.pack("<II", len(f), len(p)) for f, p in zip(frames, parts, strict=True))
    table += struct.pack("<IBI", len(frames), 0, 0x8F92EAB1)
    return b"".join([*frames, struct.pack("<II", 0x184D2A5E, len(table)), table])


@pytest.mark.parametrize(("first", "last"), [(0, 4), (0, 1), (1, 3), (3, 4)])
def test_frames_are_read_without_the_others(first: int, last: int) -> None:
    assert read(DATA, first, last) == (CONTENT[first * FRAME : last * FRAME], True)


def test_a_file_of_an_earlier_version_is_read_and_its_content_is_not_checked() -> None:
    assert read(without_checksums(), 1, 4) == (CONTENT[FRAME:], False)


def test_a_file_with_the_sums_of_another_content_is_refused() -> None:
    with pytest.raises(CodecError, match="sums of the compressed frames 1 to 2 differ"):
        read(DATA, 1, 3, SUMS[:8] + bytes(8))
    assert read(DATA, 0, 2, SUMS[:8] + bytes(8))[0] == CONTENT[: 2 * FRAME]


def test_other_programs_read_the_file() -> None:
    """The table is in a skippable frame."""
    reader = zstandard.ZstdDecompressor().stream_reader(DATA, read_across_frames=True)
    assert reader.readall() == CONTENT


def test_damage_never_gives_another_content_as_checked() -> None:
    """A file whose checksums were removed by the damage is checked by the caller."""
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(2000):
        damaged = bytearray(DATA)
        for position in rng.integers(0, len(DATA), rng.integers(1, 4)):
            damaged[position] = rng.integers(0, 256)
        if rng.random() < 0.2:
            del damaged[int(rng.integers(0, len(DATA))) :]
        try:
            content, is_checked = read(bytes(damaged), 0, 4)
        except CodecError:
            refused += 1
        else:
            assert content == CONTENT if is_checked else len(content) <= len(CONTENT)
    assert refused > 1900


def test_frames_without_a_checksum_are_refused_in_a_file_whose_table_states_sums() -> None:
    damaged = bytearray(DATA)
    assert damaged[4] & 4  # flag of the checksum in the header of the first frame
    damaged[4] &= ~4
    with pytest.raises(CodecError, match="compressed frame 0: no checksum"):
        read(bytes(damaged), 0, 4)


def test_a_frame_that_states_a_huge_content_is_refused() -> None:
    frame = zstandard.ZstdCompressor().compress(bytes(1 << 24))
    table = struct.pack("<II", len(frame), len(CONTENT)) + struct.pack("<IBI", 1, 0, 0x8F92EAB1)
    data = frame + struct.pack("<II", 0x184D2A5E, len(table)) + table
    with pytest.raises(CodecError, match="16777216 bytes of content, expected 3001"):
        read(data, 0, 1)
    with pytest.raises(CodecError, match="1 compressed frames: expected 4 or more"):
        read(data, 0, 4)
