# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/history``: what happened, and other services' journals entered in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Reply, Request
from cdff_common.errors import InputError
from dpm_store.events import Entry
from services.dpm.operations import Dpm
from services.dpm.parameters import check_names, integer

_MAX_ENTRIES = 1000


def history(dpm: Dpm, request: Request) -> Reply:
    """Without a body what happened after ``since``: ``{items, next, more}``; with one, enter a journal's lines.

    The body is ``{origin, entries: [{number, stamp_ns, scope, kind, body}]}``; the reply ``{last}`` comes after the
    commit: every entry up to that number is kept, once.
    """
    p = request.parameters
    if request.payload:
        check_names(p, frozenset({"robot", "request"}))
        origin, entries = _entries(request.body())
        return Reply.of({"last": dpm.record_from(origin, entries)})
    check_names(p, frozenset({"since", "kind", "scope", "limit", "robot", "request"}))
    limit = integer(p, "limit", low=1, high=_MAX_ENTRIES) or _MAX_ENTRIES
    kinds = tuple(p["kind"].split(",")) if "kind" in p else ()
    return Reply.of(dpm.history(integer(p, "since") or 0, limit, kinds, p.get("scope")))


def _entries(body: Any) -> tuple[str, list[Entry]]:
    try:
        origin, lines = str(body["origin"]), list(body["entries"])
        entries = [
            Entry(int(e["number"]), int(e["stamp_ns"]), str(e["scope"]), str(e["kind"]), dict(e["body"])) for e in lines
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"history: {error!r}; expected a map of origin and entries, each number stamp_ns scope kind body"
        ) from error
    if len(entries) > _MAX_ENTRIES or not isinstance(body, Mapping):
        raise InputError(f"history: {len(entries)} entries, expected at most {_MAX_ENTRIES} in one call")
    return origin, entries
