# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Captures of a Velodyne lidar as logs, decoded by velodyne_decoder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.contract.foreign_names import robot_name
from cdff_common.errors import CodecError, InputError
from cdff_common.types import LidarScan
from cdff_dev.logs.formats.pcap.packets import Capture
from cdff_dev.logs.source import (
    LogSample,
    LogSource,
    StreamInfo,
    Unconverted,
    chosen_streams,
    recorded_header,
)

#: Size of the data packets of all models, and of their position packets.
_DATA_BYTES, _POSITION_BYTES = 1206, 512
#: Last bytes of the packets of models other than HDL-64E, whose calibration is in its packets: HDL-32E,
#: VLP-16, Puck Lite and Hi-Res, VLP-32C, VLS-128.
_MODEL_IDS = (0x21, 0x22, 0x24, 0x28, 0xA1)
#: Factor from intensities of 8 bits to 16 bits.
_INTENSITY_FACTOR = 257.0


class VelodyneLog(LogSource):
    """A capture as a ``LogSource`` with the stream ``/{robot}/lidar.scan``.

    A sweep ends where the azimuth passes 0. Its points have the times of their lasers, relative to the
    arrival of its first packet. Opening a capture decodes it once, for the stamps. ``others`` are files next
    to it that are not converted.

    Raises
    ------
    InputError
        If velodyne_decoder is not installed, or the capture has no data packets of a Velodyne.
    """

    def __init__(self, path: Path, others: Mapping[str, Unconverted] | None = None) -> None:
        self._path = path
        self._capture = Capture(path)
        self._unconverted: dict[str, Unconverted] = dict(others or {})
        self._decoder_of = _library()
        self._robot = robot_name(path)
        self._name = f"/{self._robot}/lidar.scan"
        sizes: Counter[int] = Counter()
        for datagram in self._capture.datagrams():
            if len(datagram.data) == _DATA_BYTES and not sizes[_DATA_BYTES]:
                self._model_id = datagram.data[-1]
            sizes[len(datagram.data)] += 1
        if not sizes[_DATA_BYTES]:
            known = self._capture.description(sizes)
            raise InputError(
                f"{path}: no packets of a Velodyne ({_DATA_BYTES} bytes); its UDP packets: {known}. A "
                f"capture of an Ouster needs the sensor's metadata: put {path.stem}.json next to it or name "
                "the file with --calibration; convert those of other lidars with the manufacturer's tool"
            )
        if further := sum(count for size, count in sizes.items() if size != _DATA_BYTES):
            reason = f"{sizes[_POSITION_BYTES]} of them position packets"
            self._unconverted["other packets"] = Unconverted("UDP packet", further, reason)
        stamps_ns = [stamp_ns for stamp_ns, _ in self._sweeps()]
        self._count = len(stamps_ns)
        self._info = StreamInfo(
            "LidarScan", self._count, min(stamps_ns, default=0), max(stamps_ns, default=0)
        )

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """The stream of the sweeps."""
        return {self._name: self._info}

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Packets without a stream, and the end of a damaged file."""
        return self._unconverted | self._capture.unconverted

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the sweeps in the order of their stamps.

        Raises
        ------
        InputError
            If a stream is not in the log.
        """
        if not chosen_streams(self.streams, streams):
            return
        frame = f"{self._robot}/lidar"
        last_ns = 0
        for seq, (stamp_ns, points) in enumerate(self._sweeps()):
            if stamp_ns < last_ns:
                raise CodecError(
                    f"{self._path}: sweep {seq} begins before the previous one; expected captured order"
                )
            last_ns = stamp_ns
            header = recorded_header(self._name, seq, stamp_ns, frame=frame)
            yield LogSample(self._name, "LidarScan", stamp_ns, seq, _scan(points, stamp_ns, frame), header)

    def _sweeps(self) -> Iterator[tuple[int, Any]]:
        """Yield stamp and points of each sweep."""
        decoder = self._decoder_of(self._path, self._model_id)
        for datagram in self._capture.datagrams():
            if len(datagram.data) == _DATA_BYTES:
                arrival_s = datagram.arrival_ns * 1e-9
                yield from self._decode_scans(partial(decoder.decode, arrival_s, datagram.data, True))
        yield from self._decode_scans(partial(decoder.finish, True))

    def _decode_scans(self, call: Any) -> Iterator[tuple[int, Any]]:
        """Yield stamp and points of the scan that a call of the decoder completes, if any; raises
        CodecError.
        """
        try:
            completed_scan = call()
        except (RuntimeError, ValueError, TypeError) as error:
            raise CodecError(f"{self._path}: damaged packet: {error}") from error
        if completed_scan is not None and len(completed_scan[1]):
            yield round(completed_scan[0].host * 1e6) * 1000, completed_scan[1]

    def close(self) -> None:
        """Close the file, which is only open while it is read."""


def _library() -> Any:
    """Return a function that makes a decoder; raises InputError without velodyne_decoder."""
    try:
        import velodyne_decoder  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError(
            'captures need velodyne_decoder: install the extra "logs", for example pip install "cdff[logs]"'
        ) from error

    def decoder(path: Path, model_id: int) -> Any:
        import dpkt  # type: ignore[import-untyped]

        if model_id in _MODEL_IDS:
            return velodyne_decoder.StreamDecoder(velodyne_decoder.Config(timestamp_first_packet=True))
        try:
            model, calibration = velodyne_decoder.hdl64e.detect_hdl64e(str(path))
        except (
            ValueError,
            RuntimeError,
            TypeError,
            LookupError,
            OSError,
            MemoryError,
            dpkt.dpkt.Error,
        ) as error:
            raise CodecError(f"{path}: model and calibration of an HDL-64E not found: {error}") from error
        config = velodyne_decoder.Config(model=model, calibration=calibration, timestamp_first_packet=True)
        return velodyne_decoder.StreamDecoder(config)

    return decoder


def _scan(points: Any, stamp_ns: int, frame: str) -> LidarScan:
    """Return the points of a sweep; times before its stamp are those of its first lasers."""
    offsets_us = np.round(points["time"].astype(np.float64) * 1e6).astype(np.int64)
    earliest_us = int(offsets_us.min(initial=0))
    start_ns = stamp_ns + earliest_us * 1000
    return LidarScan.from_arrays(
        np.stack([points[axis] for axis in "xyz"], axis=1),
        (offsets_us - earliest_us).astype(np.uint32),
        frame=frame,
        t0_ns=start_ns,
        t1_ns=start_ns + int((offsets_us - earliest_us).max(initial=0)) * 1000,
        intensity=np.clip(np.round(points["intensity"] * _INTENSITY_FACTOR), 0, 65535).astype(np.uint16),
        ring=points["ring"].astype(np.uint16),
    )
