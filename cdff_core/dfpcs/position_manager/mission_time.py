# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mission time from the stamps of the samples: distinguishes wrong stamps from jumps of the mission clock."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.measurement import FIXES

#: Nanoseconds per second.
_NS = 1e9
#: Minimum number of samples that confirm a jump.
_MIN_CONFIRMING = 3
#: Minimum time from the first to the last of these samples, nanoseconds.
_CONFIRM_NS = 1_000_000_000
#: Number of consecutive samples of another time that confirm a jump back, whichever sources they are from.
_CONFIRMING_BY_NUMBER = 200
#: Maximum number of buffered samples of another time.
_CAPACITY = 4096
#: Sources that publish irregularly: their silence carries no information.
_IRREGULAR = (*FIXES, "joints")


@dataclass(frozen=True, slots=True)
class Admission:
    """Samples to process, samples to refuse, and the jump of the clock that they confirm."""

    accepted: tuple[Sample, ...] = ()
    refused: tuple[Sample, ...] = ()
    jumped_back: bool = False
    jumped_ahead: bool = False


class MissionTime:
    """Distinguishes a wrong stamp from a jump of the mission clock.

    A sample more than ``max_ahead_s`` after the newest one, or more than ``memory_s`` before it, belongs to
    another time. It is buffered, and refused as soon as a sample of the current time follows. Three such
    samples in a row, over at least a second, confirm a jump, and all are accepted. A delayed burst of one
    source looks the same, so a jump back also needs a sample of the other time from every source that was
    publishing.
    """

    def __init__(self, config: PositionManagerConfig) -> None:
        self._ahead_ns = int(config.clock.max_ahead_s * _NS)
        self._back_ns = int(config.timeline.memory_s * _NS)
        self._silence_ns = int(config.clock.max_silence_s * _NS)
        self._newest_ns: int | None = None
        self._newest_of_port_ns: dict[str, int] = {}
        self._buffer: deque[Sample] = deque(maxlen=_CAPACITY)

    def start(self, stamp_ns: int) -> None:
        """Set the current time."""
        self._newest_ns = stamp_ns

    def admit(self, sample: Sample) -> Admission:
        """Accept, refuse or buffer a sample."""
        newest_ns, ahead_ns = self._newest_ns, 0
        if newest_ns is not None:
            ahead_ns = sample.stamp_ns - newest_ns
        if newest_ns is None or -self._back_ns <= ahead_ns <= self._ahead_ns:
            refused = tuple(self._buffer)
            self._buffer.clear()
            self._record_stamp(sample)
            return Admission((sample,), refused)
        refused = self._add_to_buffer(sample, ahead_ns > 0)
        if not self._is_jump_confirmed(ahead_ns > 0):
            return Admission((), refused)
        accepted = tuple(sorted(self._buffer, key=lambda s: s.stamp_ns))
        self._buffer.clear()
        if ahead_ns < 0:
            self._newest_ns, self._newest_of_port_ns = None, {}
        for buffered in accepted:
            self._record_stamp(buffered)
        return Admission(accepted, refused, jumped_back=ahead_ns < 0, jumped_ahead=ahead_ns > 0)

    def _record_stamp(self, sample: Sample) -> None:
        """Update the newest stamp, of all samples and of the port."""
        stamp_ns, newest = sample.stamp_ns, self._newest_of_port_ns
        self._newest_ns = max(stamp_ns, self._newest_ns or stamp_ns)
        newest[sample.port] = max(stamp_ns, newest.get(sample.port, stamp_ns))

    def _add_to_buffer(self, sample: Sample, ahead: bool) -> tuple[Sample, ...]:
        """Buffer a sample with others of about the same time; return the samples removed from the buffer."""
        refused: tuple[Sample, ...] = ()
        if self._buffer:
            low, high = self._buffer_span()
            newest_ns = self._newest_ns or 0
            # A source that publishes rarely may be silent for as long again.
            apart_ns = max(self._silence_ns, 2 * (low - newest_ns))
            if not low - self._back_ns <= sample.stamp_ns <= high + apart_ns or ahead != (high > newest_ns):
                refused = tuple(self._buffer)
                self._buffer.clear()
            elif len(self._buffer) == _CAPACITY:
                refused = (self._buffer[0],)
        self._buffer.append(sample)
        return refused

    def _buffer_span(self) -> tuple[int, int]:
        """Return the first and the last stamp in the buffer, nanoseconds."""
        stamps = [s.stamp_ns for s in self._buffer]
        return min(stamps), max(stamps)

    def _is_jump_confirmed(self, ahead: bool) -> bool:
        """Return whether the buffered samples confirm that the mission time has jumped, ``ahead`` or back.

        A jump ahead needs only enough samples over enough time. A jump back also needs many samples, or
        samples of all ports that publish.
        """
        low, high = self._buffer_span()
        if len(self._buffer) < _MIN_CONFIRMING or high - low < _CONFIRM_NS:
            return False
        if ahead or len(self._buffer) >= _CONFIRMING_BY_NUMBER:
            return True
        newest = {port: ns for port, ns in self._newest_of_port_ns.items() if port not in _IRREGULAR}
        since_ns = max(newest.values(), default=0) - 2 * _CONFIRM_NS
        publishing = {port for port, ns in newest.items() if ns >= since_ns}
        return publishing <= {s.port for s in self._buffer}
