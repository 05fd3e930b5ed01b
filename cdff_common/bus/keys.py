# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Key expressions of contract §5: the one place where they are spelt.

``{scope}`` is a robot id or ``ground``. ``**`` does not match the verbatim chunks ``@v1 @rpc @alive``: name them.
"""

from __future__ import annotations

import re

from cdff_common.errors import InputError

PREFIX = "cdff/@v1"
GROUND = "ground"
CLOCK = f"{PREFIX}/{GROUND}/clock"

_CHUNK = re.compile(r"[a-z0-9_]+\Z")


def _chunk(name: str, text: str) -> str:
    if text != "*" and not _CHUNK.match(text):
        raise InputError(f"{name}={text!r}: a key chunk holds a-z, 0-9 and _ only")
    return text


def sensor(robot: str, sensor_name: str, stream: str) -> str:
    """Samples in."""
    return f"{PREFIX}/{_chunk('robot', robot)}/sensor/{_chunk('sensor', sensor_name)}/{_chunk('stream', stream)}"


def product(robot: str, dfpc: str, port: str) -> str:
    """Products out."""
    return f"{PREFIX}/{_chunk('robot', robot)}/product/{_chunk('dfpc', dfpc)}/{_chunk('port', port)}"


def source(robot: str, wiring: str) -> str:
    """Key of a profile's input: ``sensor/{sensor}/{stream}`` or ``product/{dfpc}/{port}``."""
    kind, owner, item = wiring.split("/")
    return sensor(robot, owner, item) if kind == "sensor" else product(robot, owner, item)


def dfpc_status(robot: str, dfpc: str) -> str:
    """State, counters, run times, last error; cached for late joiners."""
    return f"{PREFIX}/{_chunk('robot', robot)}/dfpc/{_chunk('dfpc', dfpc)}/status"


def dfpc_store(robot: str, dfpc: str, item: str) -> str:
    """The DFPC's local data store."""
    return f"{PREFIX}/{_chunk('robot', robot)}/dfpc/{_chunk('dfpc', dfpc)}/store/{_chunk('item', item)}"


def dfpc_rpc(robot: str, dfpc: str, verb: str) -> str:
    """``describe configure activate deactivate status`` or ``call/{operation}``."""
    for part in verb.split("/"):
        _chunk("verb", part)
    return f"{PREFIX}/{_chunk('robot', robot)}/dfpc/{_chunk('dfpc', dfpc)}/@rpc/{verb}"


def orchestrator_rpc(scope: str, verb: str) -> str:
    """``request jobs cancel renew catalogue``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/orchestrator/@rpc/{_chunk('verb', verb)}"


def icu_rpc(scope: str, verb: str) -> str:
    """``modes set_mode`` (OG4)."""
    return f"{PREFIX}/{_chunk('scope', scope)}/icu/@rpc/{_chunk('verb', verb)}"


def dpm_rpc(scope: str, verb: str) -> str:
    """``search get put put_all update delete pose frames changes provenance retention stat``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/dpm/@rpc/{_chunk('verb', verb)}"


def dpm_product(scope: str, product_id: str) -> str:
    """Payload by id; ``*`` for all, as the DPM declares it."""
    if product_id != "*" and not re.fullmatch(r"[0-9a-f-]{36}", product_id):
        raise InputError(f"product id {product_id!r}: expected a UUID")
    return f"{PREFIX}/{_chunk('scope', scope)}/dpm/product/{product_id}"


def event(scope: str, kind: str) -> str:
    """``inserted updated deleted activated deactivated reanchored sensor_mode alarm``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/event/{_chunk('kind', kind)}"


def lead(scope: str, process: str) -> str:
    """Liveliness token of a process that leads a scope as its orchestrator, or would; ``*`` for any."""
    return f"{PREFIX}/{_chunk('scope', scope)}/@lead/{_chunk('process', process)}"


def alive(scope: str, service: str) -> str:
    """Liveliness token of a service; ``*`` for any."""
    return f"{PREFIX}/{_chunk('scope', scope)}/@alive/{_chunk('service', service)}"
