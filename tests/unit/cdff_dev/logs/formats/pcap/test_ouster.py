# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Network captures of an Ouster are read as logs; the packets are those that the manufacturer documents."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_dev.logs import open_log
from evaluation.scenes import ouster_captures as ouster

SINGLE, DUAL, SHORT = "RNG19_RFL8_SIG16_NIR16", "RNG19_RFL8_SIG16_NIR16_DUAL", "RNG15_RFL8_NIR8"
ARRIVAL_NS = ouster.ARRIVAL_S * 10**9


def ranges_mm(column: int, channel: int) -> tuple[int, int]:
    """Multiples of 8 mm; channel 3 has no return, and the second return only in channel 0."""
    return (0 if channel == 3 else 2000 + 80 * column + 8 * channel, 9000 if channel == 0 else 0)


def true_point_m(column: int, channel: int, range_mm: int) -> tuple[float, float, float]:
    """The documented formula, in the sensor frame: half a rotation from the lidar frame, and higher."""
    encoder = 2.0 * math.pi * (1.0 - column / ouster.COLUMNS)
    azimuth = -2.0 * math.pi * ouster.AZIMUTHS_DEG[channel] / 360.0
    altitude = 2.0 * math.pi * ouster.ALTITUDES_DEG[channel] / 360.0
    n = ouster.BEAM_ORIGIN_MM
    x = (range_mm - n) * math.cos(encoder + azimuth) * math.cos(altitude) + n * math.cos(encoder)
    y = (range_mm - n) * math.sin(encoder + azimuth) * math.cos(altitude) + n * math.sin(encoder)
    z = (range_mm - n) * math.sin(altitude)
    return -x / 1000.0, -y / 1000.0, (z + ouster.LIDAR_HEIGHT_MM) / 1000.0


def write(
    folder: Path, packets: list[tuple[int, bytes]], meta: dict[str, Any] | None, **options: Any
) -> Path:
    """Write lidar packets and their metadata; returns the capture."""
    records = [
        (arrival_us, frame)
        for number, (arrival_us, packet) in enumerate(packets)
        for frame in ouster.frames(packet, ouster.LIDAR_PORT, number, **options)
    ]
    path = folder / "rover.pcap"
    path.write_bytes(ouster.pcap(records, options.get("link", ouster.ETHERNET)))
    if meta is not None:
        (folder / "rover.json").write_text(json.dumps(meta))
    return path


@pytest.mark.parametrize("profile", ouster.CHANNELS)
def test_the_points_of_each_profile_are_those_of_the_documented_formula(tmp_path: Path, profile: str) -> None:
    path = write(tmp_path, ouster.sweeps(profile, 2, ranges_mm), ouster.metadata(profile), mtu=300)
    with open_log(path) as log:
        samples = list(log.samples())
        assert not log.unconverted
    assert len(samples) == 2
    truth, rings = [], []
    for column in range(ouster.COLUMNS):
        for channel in range(3):
            returns = ranges_mm(column, channel)[: 2 if profile == DUAL else 1]
            truth += [true_point_m(column, channel, r) for r in returns if r]
            rings += [channel for r in returns if r]
    scan = samples[1].value
    np.testing.assert_allclose(scan.points_m, truth, atol=2e-6)
    assert scan.ring.tolist() == rings
    np.testing.assert_array_equal(scan.intensity, (100 + scan.ring) * (257 if profile == SHORT else 1))
    assert sorted(set(scan.time_offset_us)) == [column * 3125 for column in range(ouster.COLUMNS)]
    assert samples[1].header is not None
    assert samples[1].header.frame == "rover/lidar"


def test_a_clock_that_counts_from_the_start_of_the_sensor_is_that_of_the_capture(tmp_path: Path) -> None:
    packets = ouster.sweeps(SINGLE, 3, ranges_mm)
    # One packet arrives 5 ms late: the offset is that of the others.
    packets[0] = (packets[0][0] + 5000, packets[0][1])
    with open_log(write(tmp_path, packets, ouster.metadata(SINGLE))) as log:
        stamps_ns = log.stamps_ns("/rover/lidar.scan")
    delay_ns = ouster.DELAY_US * 1000
    np.testing.assert_array_equal(stamps_ns - ARRIVAL_NS, delay_ns + np.array([1, 2, 3]) * 100_000_000)


def test_a_synchronised_clock_is_kept(tmp_path: Path) -> None:
    begin_ns = ARRIVAL_NS + 37_000_000_000
    packet = ouster.lidar_packet(SINGLE, 1, 0, begin_ns, ranges_mm)
    with open_log(write(tmp_path, [(0, packet)], ouster.metadata(SINGLE))) as log:
        assert log.stamps_ns("/rover/lidar.scan").tolist() == [begin_ns]


def test_imu_packets_are_a_stream_in_si_units_and_axes_of_the_sensor(tmp_path: Path) -> None:
    # The IMU is rotated by 90 degrees about z: its x axis is the y axis of the sensor.
    meta = ouster.metadata(SINGLE)
    meta["imu_intrinsics"] = {"imu_to_sensor_transform": [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
    path = write(tmp_path, ouster.sweeps(SINGLE, 1, ranges_mm), meta)
    imu = ouster.imu_packet(100_000_000, (1.0, 0.0, 0.5), (180.0, 0.0, -90.0))
    path.write_bytes(path.read_bytes() + ouster.pcap([(0, ouster.frames(imu, 7503, 9)[0])])[24:])
    with open_log(path) as log:
        (sample,) = log.samples(["/rover/imu.imu"])
    np.testing.assert_allclose(sample.value.acc, [0.0, 9.80665, 4.903325])
    np.testing.assert_allclose(sample.value.gyro, [0.0, math.pi, -math.pi / 2], rtol=1e-6)


def test_imu_packets_of_several_measurements_are_read(tmp_path: Path) -> None:
    meta = ouster.metadata(SINGLE)
    meta["lidar_data_format"] |= {"udp_profile_imu": "ACCEL32_GYRO32_NMEA", "imu_measurements_per_packet": 2}
    path = write(tmp_path, ouster.sweeps(SINGLE, 1, ranges_mm), meta)
    blocks = b"".join(
        struct.pack("<QHH6f", (100 + k) * 1_000_000, k, k == 0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        for k in range(2)
    )
    frame = ouster.frames(bytes(132) + blocks + bytes(32), 7503, 9)[0]
    path.write_bytes(path.read_bytes() + ouster.pcap([(0, frame)])[24:])
    with open_log(path) as log:
        assert log.streams["/rover/imu.imu"].count == 1  # the second measurement is marked invalid


def test_lost_packets_and_fragments_are_counted(tmp_path: Path) -> None:
    packets = ouster.sweeps(SINGLE, 3, ranges_mm)
    del packets[6]  # 8 columns of the second sweep
    path = write(tmp_path, packets, ouster.metadata(SINGLE), mtu=300)
    content = path.read_bytes()
    path.write_bytes(content + ouster.pcap([(0, ouster.frames(bytes(600), 7502, 77, mtu=300)[0])])[24:])
    with open_log(path) as log:
        assert log.unconverted["missing columns"].count == 8
        assert log.unconverted["datagrams with lost fragments"].count == 1
        scan = list(log.samples())[1].value
        assert len(scan.points_m) == 3 * 24


def test_a_late_packet_and_one_of_another_sensor_change_no_sweep(tmp_path: Path) -> None:
    packets = ouster.sweeps(SINGLE, 3, ranges_mm)
    packets[3], packets[4] = (
        packets[4],
        packets[3],
    )  # the last of the first sweep after the first of the second
    packets.insert(5, (0, ouster.lidar_packet(SINGLE, 3, 0, 1, ranges_mm, serial=5)))
    with open_log(write(tmp_path, packets, ouster.metadata(SINGLE))) as log:
        assert [len(sample.value.points_m) for sample in log.samples()] == [96, 96, 96]
        assert [item.count for item in log.unconverted.values()] == [1]


def test_invalid_columns_have_no_points(tmp_path: Path) -> None:
    packets = ouster.sweeps(SINGLE, 1, ranges_mm)
    packets.append((0, ouster.lidar_packet(SINGLE, 7, 0, 1, ranges_mm, status=0)))
    with open_log(write(tmp_path, packets, ouster.metadata(SINGLE))) as log:
        assert log.streams["/rover/lidar.scan"].count == 1
        assert log.unconverted["packets without a valid column"].count == 1


def test_captures_of_all_interfaces_and_of_wireshark_are_read(tmp_path: Path) -> None:
    packets = ouster.sweeps(SINGLE, 2, ranges_mm)
    path = write(tmp_path, packets, ouster.metadata(SINGLE), link=ouster.LINUX_ANY)
    with open_log(path) as log:
        expected = [sample.value.points_m for sample in log.samples()]
    assert [len(points) for points in expected] == [96, 96]
    section = struct.pack("<IIIHHqI", 0x0A0D0D0A, 28, 0x1A2B3C4D, 1, 0, -1, 28)
    # Times of this interface are in nanoseconds.
    interface = struct.pack("<IIHHIHHB3xI", 1, 28, ouster.ETHERNET, 0, 0, 9, 1, 9, 28)
    data = section + interface
    for number, (arrival_us, packet) in enumerate(packets):
        (frame,) = ouster.frames(packet, 7502, number, mtu=9000)
        padded = frame + bytes(-len(frame) % 4)
        ns = ARRIVAL_NS + arrival_us * 1000
        length = 32 + len(padded)
        block = struct.pack("<IIIIIII", 6, length, 0, ns >> 32, ns & 0xFFFFFFFF, len(frame), len(frame))
        data += block + padded + struct.pack("<I", length)
    path.write_bytes(data)
    with open_log(path) as log:
        samples = list(log.samples())
        assert log.stamps_ns("/rover/lidar.scan")[0] == ARRIVAL_NS + 100_000_000 + ouster.DELAY_US * 1000
    np.testing.assert_array_equal([sample.value.points_m for sample in samples], expected)


def test_metadata_is_found_in_the_folder_or_named(tmp_path: Path) -> None:
    path = write(tmp_path, ouster.sweeps(SINGLE, 1, ranges_mm), ouster.metadata(SINGLE))
    with open_log(tmp_path) as log:
        assert log.streams["/rover/lidar.scan"].count == 1
    elsewhere = tmp_path / "sensor" / "meta.json"
    elsewhere.parent.mkdir()
    (tmp_path / "rover.json").rename(elsewhere)
    with pytest.raises(InputError, match=r"metadata: put rover.json next to it or name the file with --cal"):
        open_log(path)
    with open_log(path, elsewhere) as log:
        assert log.streams["/rover/lidar.scan"].count == 1


def test_metadata_of_one_level_without_packet_format_is_that_of_old_firmware(tmp_path: Path) -> None:
    beams = [float(k) for k in range(64)]
    meta = {"beam_altitude_angles": beams, "beam_azimuth_angles": beams, "lidar_mode": "512x10"}
    column = struct.pack("<QHHI", 10**9, 0, 1, 0) + 64 * ouster.CHANNELS["LEGACY"](5000, 0, 1) + b"\xff" * 4
    empty = bytes(16) + bytes(64 * 12) + bytes(4)
    with open_log(write(tmp_path, [(0, column + 15 * empty)], meta, mtu=65000)) as log:
        (sample,) = log.samples()
    assert len(sample.value.points_m) == 64
    # The default position of the beams of an unknown product is used; a range contains it.
    np.testing.assert_allclose(np.linalg.norm(sample.value.points_m, axis=1), 5.0, atol=0.04)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lidar_data_format": {"udp_profile_lidar": "RNG99"}}, "pixels_per_column|columns|numbers"),
        (
            {"beam_intrinsics": {"beam_altitude_angles": [1.0, 2.0]}},
            "beam_altitude_angles: 2 numbers, expected 4",
        ),
        ({"lidar_intrinsics": {"lidar_to_sensor_transform": [1, 2]}}, "lidar_to_sensor_transform: 2 numbers"),
    ],
)
def test_impossible_metadata_are_refused_by_name(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    path = write(tmp_path, ouster.sweeps(SINGLE, 1, ranges_mm), ouster.metadata(SINGLE) | change)
    with pytest.raises(CodecError, match=f"rover.json: .*({message}).*metadata of an Ouster"):
        open_log(path)


def test_unknown_profiles_and_metadata_of_other_recordings_are_refused(tmp_path: Path) -> None:
    packets = ouster.sweeps(SINGLE, 1, ranges_mm)
    meta = ouster.metadata("RNG99")
    with pytest.raises(InputError, match=r"'RNG99'.*expected one of LEGACY"):
        open_log(write(tmp_path, packets, meta))
    with pytest.raises(InputError, match=r"no lidar packets of .*: 4 of .*Use the metadata of this"):
        open_log(write(tmp_path, packets, ouster.metadata(DUAL)))


def test_legacy_packets_of_two_sensors_need_the_port(tmp_path: Path) -> None:
    meta = ouster.metadata("LEGACY")
    path = write(tmp_path, ouster.sweeps("LEGACY", 1, ranges_mm), meta)
    second = [
        (arrival_us, frame)
        for arrival_us, packet in ouster.sweeps("LEGACY", 1, ranges_mm)
        for frame in ouster.frames(packet, 7600, 1)
    ]
    path.write_bytes(path.read_bytes() + ouster.pcap(second)[24:])
    with open_log(path) as log:
        assert log.unconverted["columns of other sensors"].count == ouster.COLUMNS
    meta["config_params"]["udp_port_lidar"] = 1
    (tmp_path / "rover.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match="ports 7502, 7600, the metadata names 1: set udp_port_lidar"):
        open_log(path)


def test_an_unsupported_link_and_an_empty_capture_are_named(tmp_path: Path) -> None:
    path = write(tmp_path, ouster.sweeps(SINGLE, 1, ranges_mm), ouster.metadata(SINGLE))
    content = path.read_bytes()
    path.write_bytes(content[:20] + struct.pack("<I", 105) + content[24:])
    with pytest.raises(InputError, match="link type 105, expected one of 0, 1"):
        open_log(path)
    path.write_bytes(content[:24])
    with pytest.raises(InputError, match=r"no lidar packets.*UDP packets: none"):
        open_log(path)
