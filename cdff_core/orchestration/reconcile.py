# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What to do next so that what runs becomes what is wanted: one pure step, repeated until nothing is left to do.

Modes come before the activations that rely on them, feeders before those they feed, deactivations in the opposite
order. What failed is tried again after a back-off; what a restarted process forgot is simply wanted and not active.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cdff_core.orchestration.world import MakerId, SensorId

#: Back-off of a failed activation or mode change: first, factor, most; seconds.
BACK_OFF_S = (0.5, 2.0, 10.0)


@dataclass(frozen=True, slots=True)
class SetMode:
    """Have the instrument control unit set a sensor's mode."""

    sensor: SensorId
    mode: str


@dataclass(frozen=True, slots=True)
class Activate:
    """Activate a DFPC."""

    maker: MakerId


@dataclass(frozen=True, slots=True)
class Deactivate:
    """Deactivate a DFPC."""

    maker: MakerId


Action = SetMode | Activate | Deactivate


@dataclass(slots=True)
class Attempt:
    """How often something failed in a row, why, and when it may be tried again (monotonic seconds)."""

    failures: int = 0
    reason: str = ""
    not_before_s: float = 0.0

    def failed(self, reason: str, now_s: float) -> None:
        """Count one more failure and set when to try again."""
        first, factor, most = BACK_OFF_S
        self.not_before_s = now_s + min(first * factor**self.failures, most)
        self.failures += 1
        self.reason = reason


@dataclass(slots=True)
class Observed:
    """What really is, as far as is known.

    Attributes
    ----------
    alive : set of MakerId
        Whose process answers.
    active : set of MakerId
        That are known to be active.
    owned : set of MakerId
        That this orchestrator activated: only those does it ever deactivate.
    modes : dict of SensorId to str
        Confirmed modes.
    attempts : dict
        Failures of makers and sensors.
    """

    alive: set[MakerId] = field(default_factory=set)
    active: set[MakerId] = field(default_factory=set)
    owned: set[MakerId] = field(default_factory=set)
    modes: dict[SensorId, str] = field(default_factory=dict)
    attempts: dict[MakerId | SensorId, Attempt] = field(default_factory=dict)

    def attempt(self, what: MakerId | SensorId) -> Attempt:
        """The failures of a maker or sensor so far."""
        return self.attempts.setdefault(what, Attempt())

    def succeeded(self, what: MakerId | SensorId) -> None:
        """Forget the failures of a maker or sensor."""
        self.attempts.pop(what, None)


def next_actions(
    wanted: Sequence[MakerId],
    wanted_modes: Mapping[SensorId, str],
    uses: Mapping[MakerId, frozenset[SensorId]],
    feeds: Mapping[MakerId, frozenset[MakerId]],
    observed: Observed,
    now_s: float,
) -> list[Action]:
    """Return what can be done now; an empty list means that all is as wanted or has to wait.

    Parameters
    ----------
    wanted : sequence of MakerId
        To be on; feeders before those they feed.
    wanted_modes : mapping of SensorId to str
        Modes the wanted makers rely on.
    uses : mapping of MakerId to frozenset of SensorId
        Sensors each maker takes samples of.
    feeds : mapping of MakerId to frozenset of MakerId
        Makers that feed each maker, as wired.
    observed : Observed
    now_s : float
        Monotonic clock, seconds.
    """

    def may(what: MakerId | SensorId) -> bool:
        attempt = observed.attempts.get(what)
        return attempt is None or attempt.not_before_s <= now_s

    actions: list[Action] = [
        SetMode(sensor, mode)
        for sensor, mode in sorted(wanted_modes.items())
        if observed.modes.get(sensor) != mode and may(sensor)
    ]
    pending = {s for s, mode in wanted_modes.items() if observed.modes.get(s) != mode}
    on = set(wanted)
    # A feeder that is dead or fails does not hold up what it feeds: the input may be optional, the feeder come back.
    coming = {m for m in on & observed.alive - observed.active if m not in observed.attempts}
    for maker in wanted:
        waits = (uses.get(maker, frozenset()) & pending) or (feeds.get(maker, frozenset()) & coming)
        if maker in observed.alive and maker not in observed.active and may(maker) and not waits:
            actions.append(Activate(maker))
    surplus = (observed.active & observed.alive & observed.owned) - on
    for maker in sorted(surplus):
        fed = {m for m in surplus if maker in feeds.get(m, frozenset())}
        if not fed and may(maker):
            actions.append(Deactivate(maker))
    return actions


def dependency_order(makers: Sequence[MakerId], feeds: Mapping[MakerId, frozenset[MakerId]]) -> list[MakerId]:
    """Makers so that feeders come first; loops, which optional inputs may close, are cut at the first name."""
    order: list[MakerId] = []
    seen: set[MakerId] = set()

    def visit(maker: MakerId) -> None:
        if maker in seen:
            return
        seen.add(maker)
        for feeder in sorted(feeds.get(maker, frozenset()) & set(makers)):
            visit(feeder)
        order.append(maker)

    for maker in sorted(makers):
        visit(maker)
    return order
