# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Providers that a request does not use after their failures: permanently, or for a time that doubles."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from cdff_core.orchestration.world import ProviderId

#: First and longest time, seconds, for which a standing request does not use a provider that failed.
_FIRST_S, _LONGEST_S = 30.0, 600.0


@dataclass(slots=True)
class Exclusions:
    """Excluded providers of one request.

    Attributes
    ----------
    is_final : bool
        Whether providers stay excluded: a request with a deadline has no time to try them again.
    """

    is_final: bool
    _until_s: dict[ProviderId, float] = field(default_factory=dict)
    _duration_s: dict[ProviderId, float] = field(default_factory=dict)

    def add(self, providers: Iterable[ProviderId], now_s: float) -> None:
        """Exclude providers from now on."""
        for provider in providers:
            if self._until_s.get(provider, -math.inf) > now_s:
                continue
            duration_s = min(2.0 * self._duration_s.get(provider, _FIRST_S / 2.0), _LONGEST_S)
            self._duration_s[provider] = duration_s
            self._until_s[provider] = math.inf if self.is_final else now_s + duration_s

    def at(self, now_s: float) -> frozenset[ProviderId]:
        """Return the providers that are excluded at a time (monotonic seconds)."""
        return frozenset(p for p, until_s in self._until_s.items() if until_s > now_s)

    def take_ended(self, now_s: float) -> frozenset[ProviderId]:
        """Return the providers whose exclusion has ended since the last call."""
        ended = frozenset(p for p, until_s in self._until_s.items() if until_s <= now_s)
        for provider in ended:
            del self._until_s[provider]
        return ended
