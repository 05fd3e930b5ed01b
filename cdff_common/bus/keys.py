# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Key expressions of the bus (docs/reference/keys.md), the only definition.

``{scope}`` is a robot id or ``ground``. ``**`` does not match the verbatim chunks ``@v1 @rpc @alive``; a key
expression must contain them.
"""

from __future__ import annotations

import re

from cdff_common.contract.names import GROUND as GROUND
from cdff_common.contract.names import PRODUCT_ID
from cdff_common.contract.wiring import Source
from cdff_common.errors import InputError

PREFIX = "cdff/@v1"
CLOCK = f"{PREFIX}/{GROUND}/clock"

_CHUNK = re.compile(r"[a-z0-9_]+\Z")


def _chunk(name: str, text: str) -> str:
    if text != "*" and not _CHUNK.match(text):
        raise InputError(f"{name}={text!r}: a key chunk contains a-z, 0-9 and _ only")
    return text


def sensor(robot: str, sensor_name: str, stream: str) -> str:
    """Return the key of the samples of a sensor."""
    return (
        f"{PREFIX}/{_chunk('robot', robot)}/sensor/{_chunk('sensor', sensor_name)}/{_chunk('stream', stream)}"
    )


def product(robot: str, dfpc: str, port: str) -> str:
    """Return the key of the products of a DFPC."""
    return f"{PREFIX}/{_chunk('robot', robot)}/product/{_chunk('dfpc', dfpc)}/{_chunk('port', port)}"


def source(robot: str, wiring: str) -> str:
    """Return the key of a profile's input: ``sensor/{sensor}/{stream}`` or ``product/{dfpc}/{port}``."""
    parsed = Source.parse(wiring)
    make = sensor if parsed.kind == "sensor" else product
    return make(robot, parsed.owner, parsed.item)


def dfpc_status(robot: str, dfpc: str) -> str:
    """Return the key of a DFPC's state, counters, run times and last error; cached for late joiners."""
    return f"{PREFIX}/{_chunk('robot', robot)}/dfpc/{_chunk('dfpc', dfpc)}/status"


def dfpc_store(robot: str, dfpc: str, item: str) -> str:
    """Return the key of an item in a DFPC's local store."""
    return f"{PREFIX}/{_chunk('robot', robot)}/dfpc/{_chunk('dfpc', dfpc)}/store/{_chunk('item', item)}"


def dfpc_rpc(robot: str, dfpc: str, verb: str) -> str:
    """Return a DFPC's call key: ``describe configure activate deactivate status`` or ``call/{operation}``."""
    for part in verb.split("/"):
        _chunk("verb", part)
    return f"{PREFIX}/{_chunk('robot', robot)}/dfpc/{_chunk('dfpc', dfpc)}/@rpc/{verb}"


def orchestrator_rpc(scope: str, verb: str) -> str:
    """Return the orchestrator's call key: ``request jobs cancel renew catalogue``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/orchestrator/@rpc/{_chunk('verb', verb)}"


def icu_rpc(scope: str, verb: str) -> str:
    """Return the call key of the Instrument Control Unit: ``modes set_mode`` (OG4)."""
    return f"{PREFIX}/{_chunk('scope', scope)}/icu/@rpc/{_chunk('verb', verb)}"


def supervisor_rpc(scope: str, verb: str) -> str:
    """Return the call key of the supervisor of a machine: ``profile``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/supervisor/@rpc/{_chunk('verb', verb)}"


def player_rpc(scope: str, verb: str) -> str:
    """Return the call key of a player of a log: ``status pause resume step speed seek loop stop``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/player/@rpc/{_chunk('verb', verb)}"


def dpm_rpc(scope: str, verb: str) -> str:
    """Return the DPM's call key: ``search get put put_all update delete pose frames …``."""
    return f"{PREFIX}/{_chunk('scope', scope)}/dpm/@rpc/{_chunk('verb', verb)}"


def dpm_product(scope: str, product_id: str) -> str:
    """Return the key of a payload by product id; ``*`` for all, as the DPM declares it."""
    if product_id != "*" and not re.fullmatch(PRODUCT_ID, product_id):
        raise InputError(f"product id {product_id!r}: expected a UUID")
    return f"{PREFIX}/{_chunk('scope', scope)}/dpm/product/{product_id}"


def contact(scope: str, direction: str) -> str:
    """Return the key of the packets between a robot and the ground: ``down`` from the robot, ``up`` to it."""
    return f"{PREFIX}/{_chunk('scope', scope)}/contact/{_chunk('direction', direction)}"


def gateway_status(robot: str, gateway: str) -> str:
    """Return the key of the counters of a gateway, by topic; cached for late joiners."""
    return f"{PREFIX}/{_chunk('robot', robot)}/gateway/{_chunk('gateway', gateway)}/status"


def event(scope: str, kind: str) -> str:
    """Return the key of events: ``inserted updated deleted activated deactivated reanchored sensor_mode
    alarm``.
    """
    return f"{PREFIX}/{_chunk('scope', scope)}/event/{_chunk('kind', kind)}"


def alarms(scope: str, service: str) -> str:
    """Return the key of the active alarms of a service; ``*`` for any."""
    return f"{PREFIX}/{_chunk('scope', scope)}/alarms/{_chunk('service', service)}"


def lead(scope: str, process: str) -> str:
    """Return the liveliness token of an orchestrator that leads a scope or stands by; ``*`` for any."""
    return f"{PREFIX}/{_chunk('scope', scope)}/@lead/{_chunk('process', process)}"


def alive(scope: str, service: str) -> str:
    """Return the liveliness token of a service; ``*`` for any."""
    return f"{PREFIX}/{_chunk('scope', scope)}/@alive/{_chunk('service', service)}"
