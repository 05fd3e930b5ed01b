# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What to do next so that what runs becomes what is wanted: one pure step, repeated until nothing is left to do.

Modes come before the activations that rely on them, feeders (configured, active and warm) before those they feed,
deactivations in the opposite order. What failed is tried again after a back-off; what a restarted process forgot is
simply wanted and not active. One in error is configured anew before it is activated, and cleaned up if nobody wants it.
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
class Configure:
    """Configure a DFPC that is not, or that is in error."""

    maker: MakerId


@dataclass(frozen=True, slots=True)
class Activate:
    """Activate a DFPC, or have an active one take its inputs from elsewhere.

    ``inputs`` is the wiring of the ports that a plan chose, ``((port, source), …)``; others are as the profile says.
    """

    maker: MakerId
    inputs: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class CleanUp:
    """Let a DFPC give back what it holds: one in error that nobody wants."""

    maker: MakerId


@dataclass(frozen=True, slots=True)
class Deactivate:
    """Deactivate a DFPC."""

    maker: MakerId


Action = SetMode | Configure | Activate | Deactivate | CleanUp


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
    lost : dict of SensorId to str
        Sensors that cannot be had, and why.
    states : dict of MakerId to str
        What makers last said of themselves: unconfigured, inactive, active or error.
    warm_at_s : dict of MakerId to float
        When an active maker may be relied on, monotonic seconds; absent ones at once.
    wired : dict of MakerId to mapping of str to str
        What feeds the ports of active makers now.
    attempts : dict
        Failures of makers and sensors.
    """

    alive: set[MakerId] = field(default_factory=set)
    active: set[MakerId] = field(default_factory=set)
    owned: set[MakerId] = field(default_factory=set)
    modes: dict[SensorId, str] = field(default_factory=dict)
    lost: dict[SensorId, str] = field(default_factory=dict)
    states: dict[MakerId, str] = field(default_factory=dict)
    warm_at_s: dict[MakerId, float] = field(default_factory=dict)
    wired: dict[MakerId, Mapping[str, str]] = field(default_factory=dict)
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
    feeding: Mapping[MakerId, Mapping[str, str]] | None = None,
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
    feeding : mapping of MakerId to mapping of str to str, optional
        What plans chose to feed ports of wanted makers.
    """

    def may(what: MakerId | SensorId) -> bool:
        attempt = observed.attempts.get(what)
        return attempt is None or attempt.not_before_s <= now_s

    # What cannot be had is waited for by nobody: whoever needs it is told, and may do without.
    pending = {s for s, m in wanted_modes.items() if observed.modes.get(s) != m and s not in observed.lost}
    actions: list[Action] = [SetMode(s, wanted_modes[s]) for s in sorted(pending) if may(s)]
    on = set(wanted)
    # A feeder that is dead or fails does not hold up what it feeds: the input may be optional, the feeder come back.
    coming = {m for m in on & observed.alive - observed.active if m not in observed.attempts}
    coming |= {m for m in on & observed.active if observed.warm_at_s.get(m, now_s) > now_s}
    before: set[MakerId] = set()
    for maker in wanted:
        if maker not in observed.alive or not may(maker):
            before.add(maker)
            continue
        inputs = tuple(sorted((feeding or {}).get(maker, {}).items()))
        # Only for those before it in the order: what optional inputs close to a loop must not wait for itself.
        waits = (uses.get(maker, frozenset()) & pending) or (feeds.get(maker, frozenset()) & coming & before)
        before.add(maker)
        if maker in observed.active:
            wired = observed.wired.get(maker, {})
            if any(wired.get(port, source) != source for port, source in inputs):
                actions.append(Activate(maker, inputs))
        elif observed.states.get(maker) in ("unconfigured", "error"):
            actions.append(Configure(maker))
        elif not waits:
            actions.append(Activate(maker, inputs))
    surplus = (observed.active & observed.alive & observed.owned) - on
    for maker in sorted(surplus):
        fed = {m for m in surplus if maker in feeds.get(m, frozenset())}
        if not fed and may(maker):
            actions.append(Deactivate(maker))
    broken = {m for m in (observed.alive & observed.owned) - on if observed.states.get(m) == "error"}
    actions.extend(CleanUp(m) for m in sorted(broken) if may(m))
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
