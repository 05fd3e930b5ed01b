# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reads and encodes samples ahead of their time, into a buffer of bounded size: pacing does not wait for
them.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import keys
from cdff_common.codecs import encode, encoding_string
from cdff_common.codecs.size_variants import wire_type
from cdff_dev.logs.source import LogSample, recorded_header, split_stream


@dataclass(slots=True, eq=False)
class Item:
    """A sample to be published: key, time, and its bytes once they are encoded.

    Attributes
    ----------
    payload : bytes or None
        None until it is encoded: samples of a sensor that is off are not, unless it comes on in time.
    """

    robot: str
    sensor: str
    stream: str
    stamp_ns: int
    key: str
    type_name: str
    attachment: bytes
    value: Any
    payload: bytes | None = None

    @property
    def encoding(self) -> str:
        """Encoding string of the payload."""
        return encoding_string(self.type_name, "uper")

    def encoded(self) -> bytes:
        """Return the payload, encoded now if necessary."""
        if self.payload is None:
            self.type_name = wire_type(self.value)
            self.payload = encode(self.value, "uper", self.type_name)
            self.value = None
        return self.payload


def item_of(sample: LogSample) -> Item:
    """Return the sample with its key and attachment; a sample without a header gets one."""
    robot, sensor, port = split_stream(sample.stream)
    header = sample.header or recorded_header(sample.stream, sample.seq, sample.stamp_ns)
    key = keys.sensor(robot, sensor, port)
    return Item(
        robot, sensor, port, sample.stamp_ns, key, sample.type_name, header.to_attachment(), sample.value
    )


class Prefetch:
    """A thread that fills a buffer from a log, and the iterator over it.

    Parameters
    ----------
    samples : iterable of LogSample
        In the order of play.
    wanted : callable
        ``wanted(robot, sensor)``: whether to encode ahead.
    capacity_bytes : int
        The buffer waits above it; one sample always fits.
    """

    def __init__(
        self,
        samples: Iterable[LogSample],
        wanted: Callable[[str, str], bool],
        capacity_bytes: int = 48_000_000,
    ) -> None:
        self._samples = samples
        self._wanted = wanted
        self._capacity = capacity_bytes
        self._buffer: deque[tuple[Item, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._ended = False
        self._closed = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._fill, name="prefetch", daemon=True)
        self._thread.start()

    def wait_filled(self, ahead_ns: int, timeout_s: float) -> None:
        """Return once the buffer is full, holds ``ahead_ns`` of mission time, or holds the rest of the
        log.
        """

        def filled() -> bool:
            span = self._buffer[-1][0].stamp_ns - self._buffer[0][0].stamp_ns if self._buffer else 0
            return self._ended or self._bytes >= self._capacity or span >= ahead_ns

        with self._changed:
            self._changed.wait_for(filled, timeout_s)

    def __iter__(self) -> Iterator[Item]:
        """Items in order; raises what reading the log raised, in its place."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._buffer or self._ended)
                if not self._buffer:
                    if self._error is not None:
                        raise self._error
                    return
                item, size = self._buffer.popleft()
                self._bytes -= size
                self._changed.notify_all()
            yield item

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = self._ended = True
            self._changed.notify_all()
        self._thread.join(5.0)

    def _fill(self) -> None:
        try:
            for sample in self._samples:
                item = item_of(sample)
                size = len(item.encoded()) if self._wanted(item.robot, item.sensor) else _size_guess(item)
                with self._changed:
                    self._changed.wait_for(lambda: self._closed or self._bytes < self._capacity)
                    if self._closed:
                        return
                    self._buffer.append((item, size))
                    self._bytes += size
                    self._changed.notify_all()
        except Exception as error:  # noqa: BLE001  # handed to the thread that plays, which raises it
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()


def _size_guess(item: Item) -> int:
    """Return the memory of a value that is not encoded; only images and scans matter."""
    return 1_000_000 if item.type_name in ("FramePair", "Frame", "LidarScan", "Pointcloud") else 1_000
