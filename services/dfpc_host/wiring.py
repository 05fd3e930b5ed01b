# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One DFPC by arguments: where its inputs come from without a profile, or instead of what the profile says.

Without a profile there are no mounts, no rover limits and no sensor modes: a DFPC that needs those says so by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import validated
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.interfaces.registry import Registry


def parse_inputs(items: Sequence[str]) -> dict[str, str]:
    """``PORT=SOURCE`` items as a mapping; raises ConfigurationError on one that is none or named twice."""
    inputs: dict[str, str] = {}
    for item in items:
        port, equals, source = item.partition("=")
        if not equals or not port or not source:
            raise ConfigurationError(f"--input {item!r}: expected PORT=SOURCE, as stereo=sensor/navcam/pair")
        if port in inputs:
            raise ConfigurationError(f"--input {port} is given twice")
        inputs[port] = source
    return inputs


def rewired(entry: DfpcEntry, inputs: Mapping[str, str]) -> DfpcEntry:
    """The entry with ``inputs`` over its own; raises ConfigurationError on a port or source that cannot be."""
    known = [p.attribute for p in Registry.default().dfpc(entry.name).input_ports]
    for port in inputs:
        if port not in known:
            raise ConfigurationError(f"--input {port}: {entry.name} has no such port; it has {', '.join(known)}")
    fields = entry.model_dump() | {"inputs": {**entry.inputs, **inputs}}
    sources = "sensor/SENSOR/STREAM, product/DFPC/PORT or dpm/ROBOT/PRODUCT"
    return validated(DfpcEntry, fields, f"{entry.name} --input ({sources})")


def bare(robot_id: str, dfpc: str, inputs: Mapping[str, str]) -> tuple[Robot, DfpcEntry]:
    """A robot of which nothing is known but its id, and one DFPC wired by ``inputs``.

    Raises
    ------
    ConfigurationError
        If a port that is not optional has no source, or none has one: nothing is guessed from names.
    """
    robot = validated(Robot, {"id": robot_id}, "--robot")
    entry = rewired(DfpcEntry(name=dfpc, inputs={}), inputs)
    ports = Registry.default().dfpc(dfpc).input_ports
    missing = [p.attribute for p in ports if p.attribute not in inputs and not p.optional]
    if not missing and not inputs and ports:
        missing = [ports[0].attribute]
    if missing:
        raise ConfigurationError(
            f"{dfpc}: nothing feeds port {missing[0]!r}; add --input {missing[0]}=sensor/SENSOR/STREAM "
            f"(or =product/DFPC/PORT), or --profile FILE with its wiring, as deploy/profiles/rover_traverse.yaml"
        )
    return robot, entry
