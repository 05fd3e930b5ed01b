# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Captures of an Ouster lidar, written byte by byte as the manufacturer documents its packets.

Sensor Data, https://static.ouster.dev/sensor-docs.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from typing import Any

#: The smallest sensor that the metadata can describe: four channels, 32 columns, 8 of them in a packet.
ALTITUDES_DEG, AZIMUTHS_DEG = (30.0, 10.0, -10.0, -30.0), (-3.0, -2.5, -3.0, -3.5)
BEAM_ORIGIN_MM, LIDAR_HEIGHT_MM = 27.67, 36.18
COLUMNS, COLUMNS_PER_PACKET = 32, 8
COLUMN_NS = 3_125_000
SERIAL, LIDAR_PORT, IMU_PORT = 992_137_000_142, 7502, 7503
ETHERNET, LINUX_ANY = 1, 113
ARRIVAL_S = 1_700_000_000
#: Delay from the time of a packet's last column to its arrival.
DELAY_US = 400
#: Words of a channel, for ranges of both returns in millimetres and the intensity.
CHANNELS: dict[str, Callable[[int, int, int], bytes]] = {
    "LEGACY": lambda r, _, i: struct.pack("<IHHHH", r | 0x3 << 28, 9, i, 7, 0),
    "RNG19_RFL8_SIG16_NIR16": lambda r, _, i: struct.pack("<IHHHH", r | 0x5 << 19, 9, i, 7, 0),
    "RNG19_RFL8_SIG16_NIR16_DUAL": lambda r, q, i: struct.pack(
        "<IIHHHH", r | 9 << 24, q | 8 << 24, i, i, 7, 0
    ),
    "RNG15_RFL8_NIR8": lambda r, _, i: struct.pack("<HBB", r // 8 | 1 << 15, i, 7),
}


def metadata(profile: str, **changes: Any) -> dict[str, Any]:
    """Return the metadata of the sensor, with changes of names of the highest level."""
    data_format = {
        "columns_per_frame": COLUMNS,
        "columns_per_packet": COLUMNS_PER_PACKET,
        "column_window": [0, COLUMNS - 1],
        "pixels_per_column": len(ALTITUDES_DEG),
        "udp_profile_lidar": profile,
        "udp_profile_imu": "LEGACY",
    }
    return {
        "beam_intrinsics": {
            "beam_altitude_angles": list(ALTITUDES_DEG),
            "beam_azimuth_angles": list(AZIMUTHS_DEG),
            "lidar_origin_to_beam_origin_mm": BEAM_ORIGIN_MM,
        },
        "lidar_intrinsics": {
            "lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, LIDAR_HEIGHT_MM, 0, 0, 0, 1]
        },
        "imu_intrinsics": {
            "imu_to_sensor_transform": [1, 0, 0, 6.0, 0, 1, 0, -11.0, 0, 0, 1, 7.0, 0, 0, 0, 1]
        },
        "lidar_data_format": data_format,
        "sensor_info": {"prod_line": "OS-0-4", "prod_sn": str(SERIAL)},
        "config_params": {"lidar_mode": "32x10", "udp_port_lidar": LIDAR_PORT, "udp_port_imu": IMU_PORT},
    } | changes


def lidar_packet(
    profile: str,
    frame_id: int,
    first_column: int,
    begin_ns: int,
    ranges_mm: Callable[[int, int], tuple[int, int]],
    *,
    serial: int = SERIAL,
    status: int = 1,
) -> bytes:
    """Return a packet of a sweep that begins at ``begin_ns``.

    ``ranges_mm`` returns both ranges of a column and a channel. The intensity is 100 plus the channel.
    """
    columns = b""
    for number in range(first_column, first_column + COLUMNS_PER_PACKET):
        channels = b"".join(
            CHANNELS[profile](*ranges_mm(number, channel), 100 + channel)
            for channel in range(len(ALTITUDES_DEG))
        )
        stamp_ns = begin_ns + number * COLUMN_NS
        if profile == "LEGACY":
            encoder = number * 90112 // COLUMNS
            legacy = struct.pack("<QHHI", stamp_ns, number, frame_id, encoder)
            columns += legacy + channels + struct.pack("<I", 0xFFFFFFFF * status)
        else:
            columns += struct.pack("<QHH", stamp_ns, number, status) + channels
    if profile == "LEGACY":
        return columns
    header = struct.pack("<HH", 1, frame_id) + (77).to_bytes(3, "little") + serial.to_bytes(5, "little")
    return header + bytes(20) + columns + bytes(32)


def imu_packet(stamp_ns: int, acceleration_g: Sequence[float], rate_deg_s: Sequence[float]) -> bytes:
    """Return a legacy IMU packet."""
    return struct.pack("<QQQ6f", 5, stamp_ns, stamp_ns, *acceleration_g, *rate_deg_s)


def frames(payload: bytes, port: int, number: int, *, mtu: int = 1500, link: int = ETHERNET) -> list[bytes]:
    """Return a UDP datagram as frames of a link, in IPv4 fragments if it is longer than ``mtu``."""
    udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
    step = (mtu - 20) // 8 * 8
    link_frames = []
    for at in range(0, len(udp), step):
        part = udp[at : at + step]
        flags = at // 8 | (0x2000 if at + step < len(udp) else 0)
        ends = b"\xc0\xa8\x01\x02", b"\xc0\xa8\x01\x01"
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(part), number % 65536, flags, 64, 17, 0, *ends)
        link_frames.append(bytes(12 if link == ETHERNET else 14) + b"\x08\x00" + ip + part)
    return link_frames


def pcap(records: Sequence[tuple[int, bytes]], link: int = ETHERNET) -> bytes:
    """Return a capture of frames with their arrivals in microseconds after ``ARRIVAL_S``."""
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, link)
    for arrival_us, frame in records:
        seconds, us = divmod(arrival_us, 1_000_000)
        data += struct.pack("<IIII", ARRIVAL_S + seconds, us, len(frame), len(frame)) + frame
    return data


def sweeps(
    profile: str, count: int, ranges_mm: Callable[[int, int], tuple[int, int]]
) -> list[tuple[int, bytes]]:
    """Return lidar packets with their arrivals; the sweeps begin at times of the sensor of 100 ms each."""
    timed_packets = []
    for sweep in range(count):
        begin_ns = (sweep + 1) * COLUMNS * COLUMN_NS
        for first in range(0, COLUMNS, COLUMNS_PER_PACKET):
            last_us = (begin_ns + (first + COLUMNS_PER_PACKET - 1) * COLUMN_NS) // 1000
            packet = lidar_packet(profile, 65534 + sweep & 0xFFFF, first, begin_ns, ranges_mm)
            timed_packets.append((last_us + DELAY_US, packet))
    return timed_packets


def recording(profile: str) -> dict[str, bytes]:
    """Return a capture of two sweeps and an IMU packet with its metadata: the files of a folder."""
    records = [
        (arrival_us, frame)
        for number, (arrival_us, packet) in enumerate(sweeps(profile, 2, lambda c, k: (3000 + c, 5000 + k)))
        for frame in frames(packet, LIDAR_PORT, number, mtu=300)
    ]
    imu = imu_packet(COLUMNS * COLUMN_NS, (0.0, 0.0, 1.0), (1.0, 2.0, 3.0))
    records += [(records[-1][0] + 1, frame) for frame in frames(imu, IMU_PORT, 99)]
    return {"log.pcap": pcap(records), "log.json": json.dumps(metadata(profile)).encode()}
