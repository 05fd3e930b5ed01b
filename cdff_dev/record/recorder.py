# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorder of sensor samples and products on the bus."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode_payload
from cdff_common.errors import CdffError, InputError, StorageError
from cdff_common.interfaces.product import Header
from cdff_dev.record.files import RecordingFiles

logger = logging.getLogger(__name__)

#: Sensor samples and products of all robots.
DEFAULT_KEYS = ("cdff/@v1/*/sensor/**", "cdff/@v1/*/product/**")
#: Messages of a key expression that wait to be written; more are dropped and counted.
_DEPTH = 1024
#: Time for messages that were sent before the end to arrive, seconds.
_FLIGHT_S = 0.5
#: Longest wait for the messages that wait to be written at the end, seconds.
_END_S = 30.0


def stream_of(key: str) -> str:
    """Return the stream of a key of a sample or product: ``/{robot}/{sensor or DFPC}.{stream or port}``.

    Raises InputError for other keys.
    """
    parts = key.split("/")
    if len(parts) != 6 or parts[3] not in ("sensor", "product"):
        raise InputError(f"key {key!r}: expected …/sensor/SENSOR/STREAM or …/product/DFPC/PORT")
    return f"/{parts[2]}/{parts[4]}.{parts[5]}"


@dataclass(slots=True)
class Recorded:
    """Counts of a recording.

    Attributes
    ----------
    by_stream : Counter
        Number of samples of each stream.
    size : int
        Size of their payloads, bytes.
    refused : Counter
        Number of messages of each key that are no sample, or that the log cannot hold.
    """

    by_stream: Counter[str] = field(default_factory=Counter)
    size: int = 0
    refused: Counter[str] = field(default_factory=Counter)


class Recorder:
    """Writes the messages of key expressions to logs until ``close``; thread-safe.

    Every message that arrives after the constructor is written, or counted in ``dropped`` or ``refused``.

    Parameters
    ----------
    bus : Bus
    keyexprs : collection of str
    files : RecordingFiles
    on_fault : callable, optional
        Called once, when the log cannot be written any more; ``close`` raises the reason.
    """

    def __init__(
        self,
        bus: Bus,
        keyexprs: Collection[str],
        files: RecordingFiles,
        on_fault: Callable[[], object] | None = None,
    ) -> None:
        self._files, self._on_fault = files, on_fault
        self._fault: StorageError | None = None
        self._lock = threading.Lock()
        self._recorded = Recorded()
        self._subscriptions = [bus.subscribe(key, self._record, depth=_DEPTH) for key in keyexprs]
        bus.alive(keys.alive("*", "router"))  # its answer follows the subscriptions

    @property
    def dropped(self) -> int:
        """Number of messages that were dropped because writing was too slow."""
        return sum(subscription.dropped for subscription in self._subscriptions)

    @property
    def samples(self) -> int:
        """Number of samples written so far."""
        return self._recorded.by_stream.total()

    def close(self) -> Recorded:
        """Write the messages that were sent so far, complete the log and return the counts.

        Raises StorageError if the log could not be written.
        """
        if self._fault is None:
            time.sleep(_FLIGHT_S)
        for subscription in self._subscriptions:
            subscription.finish(_END_S)
        with self._lock:
            try:
                self._files.close()
            except StorageError as error:
                self._fault = self._fault or error
        if self._fault is not None:
            raise StorageError(
                f"{self._fault}; of {self.samples} samples, those on the disk are in "
                f"{', '.join(str(path) for path in self._files.existing()) or 'no file'}"
            ) from self._fault
        return self._recorded

    def _record(self, message: Message) -> None:
        """Write a sample to the log; a malformed one is counted, a full disk ends the recording."""
        try:
            stream = stream_of(message.key)
            header = Header.from_attachment(message.attachment)
            value = decode_payload(message.payload, message.encoding)
            stamp_ns = header.t1_ns // 1000 * 1000
            with self._lock:
                if self._fault is not None:
                    return
                self._files.write(stream, value, stamp_ns, header, len(message.payload))
                self._recorded.by_stream[stream] += 1
                self._recorded.size += len(message.payload)
        except StorageError as error:
            self._end_with(error)
        except CdffError as error:
            self._recorded.refused[message.key] += 1
            if self._recorded.refused[message.key] == 1:
                logger.warning("%s is not recorded: %s", message.key, error)

    def _end_with(self, fault: StorageError) -> None:
        """Keep the first reason why the log cannot be written, and report it."""
        with self._lock:
            if self._fault is not None:
                return
            self._fault = fault
        if self._on_fault is not None:
            self._on_fault()
