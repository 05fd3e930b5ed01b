# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Network captures of a Velodyne are read as logs; the packets are those of a VLP-16."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log

pytest.importorskip("velodyne_decoder")
RANGE_M = 10.0
START_S = 1_600_000_000


def vlp16_packet(number: int) -> bytes:
    """12 blocks of 0.4 degrees, all ranges 10 m; the packet of number n begins at n times 4.8 degrees."""
    blocks = b""
    for k in range(12):
        azimuth = int((number * 12 + k) * 40) % 36000
        blocks += struct.pack("<HH", 0xEEFF, azimuth) + 32 * struct.pack("<HB", int(RANGE_M / 0.002), 100)
    return blocks + struct.pack("<IBB", number * 1327 % 3_600_000_000, 0x37, 0x22)


def capture(packets: list[bytes]) -> bytes:
    """A pcap file of UDP packets, 1.327 ms apart."""
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for k, packet in enumerate(packets):
        udp = struct.pack(">HHHH", 2368, 2368, 8 + len(packet), 0) + packet
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, bytes(4), bytes(4)) + udp
        frame = bytes(12) + b"\x08\x00" + ip
        data += struct.pack("<IIII", START_S, k * 1327, len(frame), len(frame)) + frame
    return data


def test_a_capture_is_a_stream_of_sweeps(tmp_path: Path) -> None:
    path = tmp_path / "rover.pcap"
    path.write_bytes(capture([*(vlp16_packet(k) for k in range(170)), bytes(512)]))
    with open_log(path) as log:
        samples = list(log.samples())
        assert log.streams["/rover/lidar.scan"].count == len(samples) >= 2
        assert log.unconverted["other packets"].count == 1
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(samples))
    scan = samples[1].value
    np.testing.assert_allclose(np.linalg.norm(scan.points_m, axis=1), RANGE_M, atol=0.1)
    assert scan.time_offset_us.max() == pytest.approx(100_000, rel=0.1)
    assert set(scan.ring) == set(range(16))
    assert abs(scan.t0_ns - samples[1].stamp_ns) < 2_000_000


def test_a_truncated_capture_is_read_up_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "rover.pcap"
    path.write_bytes(capture([vlp16_packet(k) for k in range(100)])[:-30])
    with open_log(path) as log:
        assert len(list(log.samples())) >= 1
        assert [item.type_name for item in log.unconverted.values()] == ["damaged part"]


def test_captures_of_other_devices_are_named(tmp_path: Path) -> None:
    path = tmp_path / "ouster.pcap"
    path.write_bytes(capture([bytes(6464)]))
    with pytest.raises(InputError, match="1 of 6464 bytes"):
        open_log(path)
    path.write_bytes(b"\x0a\x0d\x0d\x0a" + bytes(100))
    with pytest.raises(InputError, match="byte 0: byte-order magic 00000000"):
        open_log(path)
