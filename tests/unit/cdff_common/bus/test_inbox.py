# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bound of the payloads of unanswered calls."""

from __future__ import annotations

from cdff_common.bus.inbox import Inbox


def test_payloads_exceed_the_capacity_by_one_at_most() -> None:
    inbox = Inbox(100)
    assert inbox.take(60)
    assert inbox.take(1000), "a large payload is not refused because of small ones"
    assert not inbox.take(1)
    assert inbox.take(0), "calls without a payload are not limited"
    inbox.release(1000)
    assert inbox.take(1)
