# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/history``: events, and journal entries of other services."""

from __future__ import annotations

from cdff_common.bus import Reply, Request
from cdff_common.contract.parameters import Parameters
from cdff_common.contract.queries import HistoryParameters
from dpm_store import Event
from services.dpm.bus.calls import parse_call
from services.dpm.operations.dpm import Dpm
from services.dpm.queries.bodies import JOURNAL, validated


def history(dpm: Dpm, request: Request) -> Reply:
    """Return the events after ``since``: ``{items, next, more}``; with a payload add journal entries.

    The body is ``{origin, entries: [{number, stamp_ns, scope, kind, body}]}``; the reply ``{last}`` is sent
    after the commit: every entry up to that number is stored, once.
    """
    if request.payload:
        parse_call(Parameters, request)
        journal = validated(JOURNAL, request.body(), "history")
        entries = [Event(e.number, e.stamp_ns, e.scope, e.kind, e.body) for e in journal.entries]
        return Reply.of({"last": dpm.writer.record_from(journal.origin, entries)})
    p = parse_call(HistoryParameters, request)
    return Reply.of(dpm.reports.history(p.since, p.limit, p.kind, p.scope))
