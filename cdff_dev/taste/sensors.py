# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensors of a profile from an interface view of TASTE."""

from __future__ import annotations

import re

from cdff_common.codecs.wire_types import message_node
from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.registry import Registry
from cdff_dev.generate.asn1_model import snake_case
from cdff_dev.new.profile import KINDS, RobotDraft, SensorDraft
from cdff_dev.taste.views import Function, InterfaceView

#: Beginnings of the names of types that other projects give to types of the same meaning.
_PREFIX = re.compile(r"(?:asn1Scc|Base_samples_(?:frame_)?)")


def robot_of_view(view: InterfaceView, robot: str, source: str) -> tuple[RobotDraft, list[str]]:
    """Return a robot with a sensor for each function that sends messages of types of CDFF.

    Functions with the name of a DFPC are no sensors. The second result lists the messages that became no
    stream.

    Raises
    ------
    InputError
        If no function sends a message of a known type.
    """
    dfpcs = set(Registry.default().dfpcs)
    sensors: list[SensorDraft] = []
    others: list[str] = []
    for function in view.functions:
        name = _key_name(function.name)
        if name in dfpcs:
            continue
        streams = _streams(function, others)
        if streams:
            kinds = [KINDS[t] for t in streams.values() if t in KINDS]
            first = sorted(streams.items(), key=lambda stream: stream[1] not in KINDS)
            kind = kinds[0] if kinds else "other"
            frame = f"{robot}/base" if kind == "wheels" else f"{robot}/{name}"
            sensors.append(SensorDraft(name, kind, frame, dict(first), 0.0))
    if not sensors:
        reason = f": {others[0]}" if others else ""
        raise InputError(f"{source}: no function sends a message of a type of CDFF{reason}")
    return RobotDraft(robot, sensors), others


def _streams(function: Function, others: list[str]) -> dict[str, str]:
    """Return the types of the messages that a function sends, by stream."""
    streams = {}
    for interface in function.interfaces:
        if interface.is_provided or not interface.parameters:
            continue
        name = f"{function.name}.{interface.name}"
        if len(interface.parameters) > 1 or interface.parameters[0].is_output:
            others.append(f"{name} is a call, not a message")
            continue
        found = interface.parameters[0].type
        type_name = _type_name(found)
        if type_name is None:
            others.append(f"{name} has the type {found}, which is no type of CDFF")
        else:
            streams[_key_name(interface.name)] = type_name
    return streams


def _type_name(name: str) -> str | None:
    """Return the type of CDFF that a type of a data view names, None if there is none."""
    try:
        return message_node(_PREFIX.sub("", name, count=1)).name
    except CodecError:
        return None


def _key_name(name: str) -> str:
    return re.sub(r"[^a-z0-9_]+", "_", snake_case(name)).strip("_") or "sensor"
