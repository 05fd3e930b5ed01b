# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading and encoding of samples ahead of their time, in a thread, into a buffer of limited size."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from cdff_common.bus import keys
from cdff_common.codecs import encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_dev.logs.source import LogSample, recorded_header, split_stream


@dataclass(slots=True, eq=False)
class Item:
    """A sample to be published.

    Attributes
    ----------
    payload : bytes or None
        Encoded value; None until it is encoded. A sample is encoded ahead only if its sensor is on.
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
    """Return the item of a sample; a sample without a header gets one."""
    robot, sensor, port = split_stream(sample.stream)
    header = sample.header or recorded_header(sample.stream, sample.seq, sample.stamp_ns)
    key = keys.sensor(robot, sensor, port)
    return Item(
        robot, sensor, port, sample.stamp_ns, key, sample.type_name, header.to_attachment(), sample.value
    )


class Prefetch:
    """An iterator over the items of a log, which a thread reads ahead into a buffer.

    Parameters
    ----------
    samples : iterable of LogSample
        Samples in the order in which they are played.
    is_needed : callable
        ``is_needed(robot, sensor)`` returns True if samples of the sensor are encoded ahead.
    capacity_bytes : int
        Size of the buffer; no sample is added while it is exceeded.
    """

    def __init__(
        self,
        samples: Iterable[LogSample],
        is_needed: Callable[[str, str], bool],
        capacity_bytes: int = 48_000_000,
    ) -> None:
        self._samples = samples
        self._is_needed = is_needed
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
        """Wait until the buffer is full, spans ``ahead_ns`` of mission time, or contains the rest of the log.

        Returns after ``timeout_s`` at the latest.
        """

        def is_filled() -> bool:
            span_ns = self._buffer[-1][0].stamp_ns - self._buffer[0][0].stamp_ns if self._buffer else 0
            return self._ended or self._bytes >= self._capacity or span_ns >= ahead_ns

        with self._changed:
            self._changed.wait_for(is_filled, timeout_s)

    def __iter__(self) -> Iterator[Item]:
        """Yield the items in order; an error of reading the log is raised after the items before it."""
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
        """Read samples ahead until the buffer is full or closed; an error is passed to the reader."""
        try:
            for sample in self._samples:
                item = item_of(sample)
                is_needed = self._is_needed(item.robot, item.sensor)
                size = len(item.encoded()) if is_needed else _approximate_size(item)
                with self._changed:
                    self._changed.wait_for(lambda: self._closed or self._bytes < self._capacity)
                    if self._closed:
                        return
                    self._buffer.append((item, size))
                    self._bytes += size
                    self._changed.notify_all()
        except Exception as error:  # noqa: BLE001  # raised by __iter__ in the thread that plays
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()


def _approximate_size(item: Item) -> int:
    """Return the approximate size of a value that is not encoded, bytes; images and scans are large."""
    return 1_000_000 if item.type_name in ("FramePair", "Frame", "LidarScan", "Pointcloud") else 1_000
