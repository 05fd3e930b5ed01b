# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Records of MCAP files with damaged sizes."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from cdff_dev.logs.formats.ros.mcap_records import McapRecords

_COUNT = 20


def _file(compression: CompressionType) -> bytes:
    """Twenty messages in chunks of about five."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=400, compression=compression)
    writer.start()
    schema = writer.register_schema("text", "jsonschema", b"{}")
    channel = writer.register_channel("/text", "json", schema)
    for k in range(_COUNT):
        writer.add_message(channel, k, bytes([k]) * 60, k)
    writer.finish()
    return file.getvalue()


def _chunk_data_size(content: bytes) -> int:
    """Offset of the field with the size of the records of the first chunk."""
    at = 8
    while content[at] != Opcode.CHUNK:
        at += 9 + struct.unpack_from("<Q", content, at + 1)[0]
    name_bytes = struct.unpack_from("<I", content, at + 37)[0]
    return at + 41 + int(name_bytes)


def _read(path: Path) -> tuple[int, list[str]]:
    """Number of messages, and reasons for parts that are left out."""
    reasons: list[str] = []
    records = McapRecords(path, lambda _, reason: reasons.append(reason))
    return sum(isinstance(record, tuple) for record in records), reasons


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_chunk_with_a_damaged_size_of_its_records_is_left_out(
    compression: CompressionType, tmp_path: Path
) -> None:
    content = bytearray(_file(compression))
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    assert _read(path) == (_COUNT, [])
    at = _chunk_data_size(content)
    content[at : at + 8] = b"\xff" * 8
    path.write_bytes(content)
    count, reasons = _read(path)
    assert 0 < count < _COUNT
    assert len(reasons) == 1
    assert "damaged record of type 6" in reasons[0]


@pytest.mark.parametrize("compression", list(CompressionType))
def test_the_messages_at_the_start_of_an_incomplete_chunk_are_read(
    compression: CompressionType, tmp_path: Path
) -> None:
    content, path = _file(compression), tmp_path / "log.mcap"
    counts = []
    for length in range(9, len(content), 7):
        path.write_bytes(content[:length])
        records = McapRecords(path, lambda *_: None)
        numbers = [record[2][0] for record in records if isinstance(record, tuple)]
        assert numbers == list(range(len(numbers)))
        counts.append(len(numbers))
    assert counts == sorted(counts)
    if compression is CompressionType.NONE:  # blocks of compression have several messages
        assert set(counts) == set(range(_COUNT + 1))
