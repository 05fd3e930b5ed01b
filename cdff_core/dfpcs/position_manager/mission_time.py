# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What time it is by the samples: one that is far from it is held until others show that the clock has jumped."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimator import FIXES

_NS = 1e9
#: Samples of another time that show a jump, at least.
_SHOWN = 3
#: As many of another time, and none of the old one, show a jump back whoever is silent.
_MANY = 200
#: Samples of another time that are held; the oldest go.
_HELD = 4096
#: Sources that speak when they have something to say: their silence shows nothing.
_SELDOM = (*FIXES, "joints")


@dataclass(frozen=True, slots=True)
class Arrival:
    """What a sample leads to: samples to take, samples that are refused, and whether the clock went back or ahead."""

    taken: tuple[Sample, ...] = ()
    refused: tuple[Sample, ...] = ()
    back: bool = False
    ahead: bool = False


class MissionTime:
    """Tells a stamp that is wrong from a mission clock that jumped.

    A sample more than ``max_ahead_s`` after the newest one, or more than ``memory_s`` before it, is of another time.
    One such sample means nothing: it is held, and refused as soon as one of the old time comes. Three in a row that
    reach over ``confirm_s`` show that the clock jumped, and all of them are taken. A burst that was delayed looks like
    that too, but then not all sources are late: back goes the clock only where every source that was speaking has
    spoken of the other time.
    """

    def __init__(self, config: PositionManagerConfig) -> None:
        self._ahead_ns, self._back_ns = int(config.max_ahead_s * _NS), int(config.memory_s * _NS)
        self._confirm_ns, self._apart_ns = int(config.confirm_s * _NS), int(config.blind_s * _NS)
        self._newest_ns: int | None = None
        self._spoke_ns: dict[str, int] = {}
        self._other: deque[Sample] = deque(maxlen=_HELD)

    def begin(self, stamp_ns: int) -> None:
        """Go on from a time that is known."""
        self._newest_ns = stamp_ns

    def take(self, sample: Sample) -> Arrival:
        """What a sample leads to."""
        newest_ns, ahead_ns = self._newest_ns, 0
        if newest_ns is not None:
            ahead_ns = sample.stamp_ns - newest_ns
        if newest_ns is None or -self._back_ns <= ahead_ns <= self._ahead_ns:
            refused = tuple(self._other)
            self._other.clear()
            self._note(sample)
            return Arrival((sample,), refused)
        refused = self._gather(sample, ahead_ns > 0)
        if not self._shown(ahead_ns > 0):
            return Arrival((), refused)
        taken = tuple(sorted(self._other, key=lambda s: s.stamp_ns))
        self._other.clear()
        if ahead_ns < 0:
            self._newest_ns, self._spoke_ns = None, {}
        for other in taken:
            self._note(other)
        return Arrival(taken, refused, back=ahead_ns < 0, ahead=ahead_ns > 0)

    def _note(self, sample: Sample) -> None:
        self._newest_ns = max(sample.stamp_ns, self._newest_ns or sample.stamp_ns)
        self._spoke_ns[sample.port] = max(sample.stamp_ns, self._spoke_ns.get(sample.port, sample.stamp_ns))

    def _gather(self, sample: Sample, ahead: bool) -> tuple[Sample, ...]:
        """Hold a sample with those of its own time; others that were held are refused."""
        refused: tuple[Sample, ...] = ()
        if self._other:
            low, high = self._reach()
            newest_ns = self._newest_ns or 0
            apart_ns = max(self._apart_ns, 2 * (low - newest_ns))  # who speaks seldom is silent as long again
            if not low - self._back_ns <= sample.stamp_ns <= high + apart_ns or ahead != (high > newest_ns):
                refused = tuple(self._other)
                self._other.clear()
            elif len(self._other) == _HELD:
                refused = (self._other[0],)
        self._other.append(sample)
        return refused

    def _reach(self) -> tuple[int, int]:
        stamps = [s.stamp_ns for s in self._other]
        return min(stamps), max(stamps)

    def _shown(self, ahead: bool) -> bool:
        """Whether the samples of another time show that the clock jumped."""
        low, high = self._reach()
        if len(self._other) < _SHOWN or high - low < self._confirm_ns:
            return False
        if ahead or len(self._other) >= _MANY:
            return True
        spoke_ns = {port: spoke for port, spoke in self._spoke_ns.items() if port not in _SELDOM}
        since_ns = max(spoke_ns.values(), default=0) - 2 * self._confirm_ns
        speaking = {port for port, spoke in spoke_ns.items() if spoke >= since_ns}
        return speaking <= {s.port for s in self._other}
