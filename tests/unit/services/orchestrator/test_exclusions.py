# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Providers are excluded after failures: permanently, or for a time that doubles."""

from __future__ import annotations

from cdff_core.orchestration.world import ProviderId
from services.orchestrator.exclusions import Exclusions

FIRST, SECOND = ProviderId("mana", "first"), ProviderId("mana", "second")


def test_a_request_with_a_deadline_excludes_a_provider_for_good() -> None:
    exclusions = Exclusions(is_final=True)
    exclusions.add([FIRST], 10.0)
    assert exclusions.at(1e9) == {FIRST}
    assert exclusions.take_ended(1e9) == frozenset()


def test_the_time_of_exclusion_doubles_with_each_failure_up_to_ten_minutes() -> None:
    exclusions, now_s = Exclusions(is_final=False), 0.0
    durations_s = []
    for _ in range(7):
        exclusions.add([FIRST], now_s)
        end_s = next(t for t in range(1, 1000) if not exclusions.at(now_s + t))
        durations_s.append(end_s)
        now_s += end_s
        assert exclusions.take_ended(now_s) == {FIRST}
    assert durations_s == [30, 60, 120, 240, 480, 600, 600]


def test_an_excluded_provider_that_fails_again_is_not_excluded_for_longer() -> None:
    exclusions = Exclusions(is_final=False)
    exclusions.add([FIRST], 0.0)
    exclusions.add([FIRST, SECOND], 20.0)
    assert exclusions.at(31.0) == {SECOND}
    assert exclusions.take_ended(31.0) == {FIRST}
    assert exclusions.take_ended(31.0) == frozenset()
