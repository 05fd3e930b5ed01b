# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Captures of an Ouster lidar as logs."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.foreign_names import robot_name
from cdff_common.errors import InputError
from cdff_common.types import IMUSensors, LidarScan, Time
from cdff_dev.logs.formats.pcap.ouster_packets import PacketLayout
from cdff_dev.logs.formats.pcap.ouster_points import RayTable
from cdff_dev.logs.formats.pcap.ouster_sensor import OusterSensor, read_metadata
from cdff_dev.logs.formats.pcap.packets import Capture, Datagram
from cdff_dev.logs.indexed import IndexedLog, IndexedStream, headers
from cdff_dev.logs.source import Unconverted

_STANDARD_GRAVITY = 9.80665  # m/s2
#: Times of the sensor before 2000 count from its start.
_FIRST_DATE_NS = 946_684_800_000_000_000
#: Largest time that is converted, so that an offset can be added to it in 64 bits.
_LAST_DATE_NS = 1 << 62
#: Times further than this from the start of a sweep are damaged.
_MAX_SWEEP_NS = 10_000_000_000


@dataclass(slots=True)
class _Sweep:
    """Consecutive packets of one sweep: offsets in the file, number, earliest time, number of columns."""

    start: int
    end: int
    frame_id: int
    stamp_ns: int
    columns: int


@dataclass(slots=True)
class _Sweeps:
    """Sweeps of a sensor, and the smallest delay from a time of the sensor to the arrival of its packet."""

    sweeps: list[_Sweep] = field(default_factory=list)
    latency_ns: int = 1 << 62
    empty: int = 0

    def add(self, datagram: Datagram, layout: PacketLayout) -> None:
        """Add a lidar packet; a packet without a valid column is counted."""
        stamps_ns = layout.columns(datagram.data)["stamp_ns"]
        stamps_ns = stamps_ns[(stamps_ns > 0) & (stamps_ns < _LAST_DATE_NS)]
        if not len(stamps_ns):
            self.empty += 1
            return
        first_ns = int(stamps_ns.min())
        self.latency_ns = min(self.latency_ns, datagram.arrival_ns - int(stamps_ns.max()))
        frame_id = layout.frame_id(datagram.data)
        # A late packet belongs to the sweep before the last one.
        sweep = next((sweep for sweep in self.sweeps[:-3:-1] if sweep.frame_id == frame_id), None)
        if sweep is None:
            self.sweeps.append(_Sweep(datagram.start, datagram.end, frame_id, first_ns, len(stamps_ns)))
            return
        sweep.start, sweep.end = min(sweep.start, datagram.start), max(sweep.end, datagram.end)
        sweep.stamp_ns = min(sweep.stamp_ns, first_ns)
        sweep.columns += len(stamps_ns)

    def clock_offset_ns(self) -> int:
        """Return the offset from the time of the sensor to that of the log."""
        counts_from_start = bool(self.sweeps) and self.sweeps[0].stamp_ns < _FIRST_DATE_NS
        return self.latency_ns if counts_from_start else 0


class _Index:
    """Sweeps and IMU measurements of a sensor in a capture, found by one pass over its packets."""

    def __init__(self, capture: Capture, sensor: OusterSensor, layout: PacketLayout) -> None:
        self._layout, self._serial = layout, sensor.serial
        lidar: dict[int, _Sweeps] = defaultdict(_Sweeps)
        imu: dict[int, list[NDArray[np.float64]]] = defaultdict(list)
        sizes: Counter[int] = Counter()
        for datagram in capture.datagrams():
            if self._is_lidar(datagram):
                lidar[datagram.port].add(datagram, layout)
            elif len(datagram.data) == layout.imu_bytes:
                imu[datagram.port].append(layout.imu(datagram.data))
            else:
                sizes[len(datagram.data)] += 1
        if not lidar:
            raise InputError(
                f"{capture.path}: no lidar packets of {layout.lidar_bytes} bytes, as the metadata requires "
                f"(profile {sensor.profile}, {len(sensor.altitude_rad)} channels, serial number "
                f"{sensor.serial or 'unknown'}); its UDP packets: {capture.description(sizes)}. Use the "
                "metadata of this recording"
            )
        self._port = _chosen(
            set(lidar), sensor.lidar_port, f"{capture.path}: lidar packets", "udp_port_lidar"
        )
        self.others = Counter({f"packets of {size} bytes": count for size, count in sizes.items()})
        self.sweeps = lidar[self._port].sweeps
        self.clock_offset_ns = lidar[self._port].clock_offset_ns()
        self.others["packets without a valid column"] = lidar[self._port].empty
        chosen = imu.get(
            _chosen(set(imu), sensor.imu_port, f"{capture.path}: IMU packets", "udp_port_imu") if imu else 0,
            [],
        )
        self.imu = np.concatenate([np.zeros((0, 7)), *chosen])
        self.others["IMU packets of other sensors"] = sum(map(len, imu.values())) - len(chosen)
        ports = sum(sweep.columns for port in lidar if port != self._port for sweep in lidar[port].sweeps)
        self.others["columns of other sensors"] = ports
        self.others = +self.others

    def packets(self, capture: Capture, sweep: _Sweep) -> bytes:
        """Return the lidar packets of a sweep, one after the other."""
        return b"".join(
            datagram.data
            for datagram in capture.datagrams(sweep.start, sweep.end)
            if datagram.port == self._port
            and self._is_lidar(datagram)
            and self._layout.frame_id(datagram.data) == sweep.frame_id
        )

    def _is_lidar(self, datagram: Datagram) -> bool:
        """Return whether a datagram is a lidar packet of this sensor, by its size and serial number."""
        if len(datagram.data) != self._layout.lidar_bytes:
            return False
        serial = self._layout.serial(datagram.data)
        return not (serial and self._serial and serial != self._serial)


def _chosen(ports: set[int], named: int, description: str, key: str) -> int:
    """Return the port of a sensor; raises InputError if there are several and the metadata names none."""
    if len(ports) == 1:
        return next(iter(ports))
    if named not in ports:
        known = ", ".join(map(str, sorted(ports)))
        raise InputError(
            f"{description} to the ports {known}, the metadata names {named or 'none'}: set {key} in it"
        )
    return named


def ouster_log(path: Path, metadata: Path, others: Mapping[str, Unconverted] | None = None) -> IndexedLog:
    """Open a capture as ``/{robot}/lidar.scan`` and ``/{robot}/imu.imu``.

    A sweep has the time of its first column. Its points are those of all returns in the sensor frame (x
    forward, z up), in the order of their times; intensities are signal photons, or reflectivities times 257.
    A sensor whose clock counts from its start gets a constant offset, so that its fastest packet arrived
    without a delay. The IMU's axes are those of the sensor frame. ``others`` are files next to the capture
    that are not converted.

    Raises
    ------
    CodecError
        If the metadata cannot be read.
    InputError
        If the profile is not supported or no packet has the size that the metadata requires.
    """
    sensor = read_metadata(metadata)
    try:
        layout = PacketLayout(sensor)
    except InputError as error:
        raise InputError(f"{metadata}: {error}") from error
    capture = Capture(path)
    index = _Index(capture, sensor, layout)
    robot = robot_name(path)
    rays = RayTable(sensor)
    lidar, imu = f"/{robot}/lidar.scan", f"/{robot}/imu.imu"
    sweep_stamps_ns = _stamps([sweep.stamp_ns + index.clock_offset_ns for sweep in index.sweeps])

    def read_scan(i: int) -> LidarScan:
        sweep = index.sweeps[i]
        columns = _plausible(layout.columns(index.packets(capture, sweep)), sweep.stamp_ns)
        points = rays.points(columns, layout.returns)
        offsets_us = (points.stamps_ns - sweep.stamp_ns) // 1000
        begin_ns = int(sweep_stamps_ns[i])
        return LidarScan.from_arrays(
            points.points_m,
            offsets_us.astype(np.uint32),
            frame=f"{robot}/lidar",
            t0_ns=begin_ns,
            t1_ns=begin_ns + int(offsets_us.max(initial=0)) * 1000,
            intensity=points.intensity,
            ring=points.ring,
        )

    streams = {
        lidar: IndexedStream(
            "LidarScan", sweep_stamps_ns, read_scan, headers(lidar, sweep_stamps_ns, frame=f"{robot}/lidar")
        )
    }
    finite = np.isfinite(index.imu).all(axis=1) & (index.imu[:, 0] < _LAST_DATE_NS)
    values = index.imu[finite]
    if len(values):
        imu_stamps_ns = _stamps(values[:, 0].astype(np.int64) + index.clock_offset_ns)
        force = _STANDARD_GRAVITY * values[:, 1:4] @ sensor.R_sensor_imu.T
        rate = np.radians(values[:, 4:7]) @ sensor.R_sensor_imu.T

        def read_imu(i: int) -> IMUSensors:
            return IMUSensors(Time.from_ns(int(imu_stamps_ns[i])), force[i], rate[i], np.zeros(3))

        streams[imu] = IndexedStream(
            "IMUSensors", imu_stamps_ns, read_imu, headers(imu, imu_stamps_ns, frame=f"{robot}/imu")
        )
    unconverted = capture.unconverted | _unconverted(index, sensor, int((~finite).sum()))
    return IndexedLog(streams, unconverted | dict(others or {}))


def _plausible(columns: NDArray[Any], begin_ns: int) -> NDArray[Any]:
    """Return the columns whose times lie in the sweep."""
    offsets_ns = columns["stamp_ns"].astype(np.int64) - begin_ns
    return columns[(offsets_ns >= 0) & (offsets_ns < _MAX_SWEEP_NS)]


def _stamps(stamps_ns: Any) -> NDArray[np.int64]:
    """Return stamps as multiples of 1000."""
    return np.array(stamps_ns, np.int64) // 1000 * 1000


def _unconverted(index: _Index, sensor: OusterSensor, bad_imu: int) -> dict[str, Unconverted]:
    """Return the packets, columns and measurements that are not converted, with the reasons."""
    contents = {
        name: Unconverted("UDP packet", count, "neither lidar nor IMU data of this sensor")
        for name, count in index.others.items()
    }
    missing = sum(max(sensor.columns_in_window - sweep.columns, 0) for sweep in index.sweeps[1:-1])
    if missing:
        reason = f"lost, or invalid, of {len(index.sweeps) - 2} sweeps without the first and the last"
        contents["missing columns"] = Unconverted("column", missing, reason)
    if bad_imu:
        contents["IMU measurements"] = Unconverted("IMU measurement", bad_imu, "values that are not finite")
    return contents
