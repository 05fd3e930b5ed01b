# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The script of a mission replay: requests and their mission times."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cdff_common.bus import keys
from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_core.orchestration.request import ProductRequest, parse_request

_HELP = (
    "expected `requests: [{at_s: 5.0, type: dem, robot: mana, …}]`, parameters as in docs/og2-interface.md"
)


@dataclass(frozen=True, slots=True)
class ScriptedRequest:
    """A request with its mission time; ``parameters`` are sent to the orchestrator."""

    at_ns: int
    request: ProductRequest
    parameters: Mapping[str, str]


def read_script(path: Path, start_ns: int, robots: Collection[str]) -> list[ScriptedRequest]:
    """Read a YAML file of requests.

    Parameters
    ----------
    path : Path
        ``requests`` is a list; each entry has ``at_s``, seconds after the first sample of the log, and the
        parameters of a request to the orchestrator. A missing id (``request``) is generated.
    start_ns : int
        Stamp of the first sample of the log.
    robots : collection of str
        Robots of the mission.

    Returns
    -------
    list of ScriptedRequest
        In order of time; requests with equal times in the order of the file.

    Raises
    ------
    InputError
        If an entry is malformed; the message names it.
    """
    document = read_mapping(path)
    entries = document.get("requests")
    if not isinstance(entries, list) or not entries or set(document) != {"requests"}:
        raise InputError(f"{path}: {_HELP}")
    script = [_entry(path, number, entry, start_ns) for number, entry in enumerate(entries, 1)]
    for number, scripted in enumerate(script, 1):
        if scripted.request.robot not in (*robots, "any"):
            known = ", ".join(robots)
            raise InputError(
                f"{path}: request {number}: robot={scripted.request.robot!r}, expected any or {known}"
            )
    ids = [s.request.id for s in script]
    repeated = {id_ for id_ in ids if ids.count(id_) > 1}
    if repeated:
        raise InputError(
            f"{path}: request {sorted(repeated)[0]!r} occurs twice; give each request its own id"
        )
    return sorted(script, key=lambda s: s.at_ns)


def _entry(path: Path, number: int, entry: Any, start_ns: int) -> ScriptedRequest:
    """Return the request of an entry; raises InputError with its number."""
    where = f"{path}: request {number}"
    if not isinstance(entry, Mapping):
        raise InputError(f"{where} is a {type(entry).__name__}; {_HELP}")
    at_s = entry.get("at_s")
    if isinstance(at_s, bool) or not isinstance(at_s, int | float) or not 0 <= at_s < 1e7:
        raise InputError(f"{where}: at_s={at_s!r}, expected seconds after the log's first sample, 0 or more")
    parameters = {name: _text(value) for name, value in entry.items() if name != "at_s"}
    try:
        parameters = {"request": f"request-{number}", **parameters}
        request = parse_request(parameters, keys.GROUND)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    if request.every_s is not None or request.explain:
        raise InputError(f"{where}: a scripted request is answered once; remove every_s and explain")
    return ScriptedRequest(start_ns + round(at_s * NS_PER_S), request, parameters)


def _text(value: Any) -> str:
    """Return a value of the file as the text of a parameter."""
    return str(value).lower() if isinstance(value, bool) else str(value)
