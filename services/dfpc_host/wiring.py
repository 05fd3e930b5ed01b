# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wiring of one DFPC by command-line arguments, without a profile or in place of its wiring.

Without a profile there are no mounts, no rover limits and no sensor modes; a DFPC that needs them refuses its
configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cdff_common.cli import key_values
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import validated
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.interfaces.registry import Registry


def parse_inputs(items: Sequence[str]) -> dict[str, str]:
    """Return ``PORT=SOURCE`` items as a mapping; raises InputError on a malformed or repeated one."""
    return key_values(items, "--input", "PORT=SOURCE, as stereo=sensor/navcam/pair")


def with_inputs(entry: DfpcEntry, inputs: Mapping[str, str]) -> DfpcEntry:
    """Return the entry with ``inputs`` in place of its own; raises ConfigurationError on an unknown port or
    malformed source.
    """
    known = [p.attribute for p in Registry.default().dfpc(entry.name).input_ports]
    for port in inputs:
        if port not in known:
            raise ConfigurationError(
                f"--input {port}: {entry.name} has no such port; it has {', '.join(known)}"
            )
    fields = entry.model_dump() | {"inputs": {**entry.inputs, **inputs}}
    sources = "sensor/SENSOR/STREAM, product/DFPC/PORT or dpm/ROBOT/PRODUCT"
    return validated(DfpcEntry, fields, f"{entry.name} --input ({sources})")


def standalone_entry(robot_id: str, dfpc: str, inputs: Mapping[str, str]) -> tuple[Robot, DfpcEntry]:
    """Return a robot with nothing but its id, and one DFPC wired by ``inputs``.

    Raises
    ------
    ConfigurationError
        If a mandatory port has no source, or no port has one.
    """
    robot = validated(Robot, {"id": robot_id}, "--robot")
    entry = with_inputs(DfpcEntry(name=dfpc, inputs={}), inputs)
    ports = Registry.default().dfpc(dfpc).input_ports
    missing = [p.attribute for p in ports if p.attribute not in inputs and not p.optional]
    if not missing and not inputs and ports:
        missing = [ports[0].attribute]
    if missing:
        raise ConfigurationError(
            f"{dfpc}: port {missing[0]!r} has no source; add --input {missing[0]}=sensor/SENSOR/STREAM "
            "(or =product/DFPC/PORT), or --profile FILE, as deploy/profiles/rover_traverse.yaml"
        )
    return robot, entry
