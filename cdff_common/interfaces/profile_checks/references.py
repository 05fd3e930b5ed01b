# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of a profile that must exist: robots, sensors, types, limits, sensor modes, products."""

from __future__ import annotations

from collections.abc import Iterator

from cdff_common import types
from cdff_common.contract.names import RESERVED_SCOPES
from cdff_common.contract.products import product_types
from cdff_common.contract.wiring import mode_names
from cdff_common.interfaces.profile import ROBOT_LIMITS, DfpcEntry, Robot
from cdff_common.interfaces.profile_checks.faults import ABSENT, Finding, nearest_name, one_of, unknown_name
from cdff_common.interfaces.profile_checks.reading import Reading
from cdff_common.interfaces.registry import Registry
from cdff_common.interfaces.sensor_profile import SensorMode
from cdff_common.interfaces.yaml_file import Location

#: Product of a retention rule for all types together.
_ALL_PRODUCTS = "*"
#: Name in place of a DFPC of products that the DPM derives.
_DERIVED = "dpm"


def reference_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the findings of the valid part of a profile."""
    profile = reading.profile
    assert profile is not None
    first_robot: dict[str, int] = {}
    for i, robot in enumerate(profile.robots):
        place: Location = ("robots", i, "id")
        if robot.id in RESERVED_SCOPES:
            yield Finding(place, "is a reserved word, expected another name of the robot", robot.id)
        if robot.id in first_robot:
            yield Finding(place, "is the id of two robots, expected a different one", robot.id)
        first_robot.setdefault(robot.id, i)
        yield from _robot_findings(reading, robot, i)
    yield from _history_findings(reading)
    yield from _retention_findings(reading)


def message_types() -> list[str]:
    """Return the names of all message types."""
    return [name for name in types.__all__ if isinstance(getattr(types, name), type)]


def _robot_findings(reading: Reading, robot: Robot, i: int) -> Iterator[Finding]:
    """Yield the findings about unknown message types and limits of a robot."""
    known_types = set(message_types())
    for name, sensor in robot.sensors.items():
        for stream, type_name in sensor.streams.items():
            if type_name not in known_types:
                place: Location = ("robots", i, "sensors", name, "streams", stream)
                nearest = nearest_name(type_name, known_types)
                problem = "no such message type; expected a type of docs/reference/types.md"
                yield Finding(place, problem, type_name, nearest)
    for limit, value in robot.limits.items():
        if limit not in ROBOT_LIMITS:
            yield _unknown_limit(("robots", i, "limits", limit), limit)
        elif value <= 0.0 or (limit.endswith("_deg") and value >= 90.0):
            expected = "more than 0 and less than 90" if limit.endswith("_deg") else "more than 0"
            yield Finding(("robots", i, "limits", limit), f"expected {expected}", value)
    names: set[str] = set()
    for j, entry in enumerate(robot.dfpcs):
        if entry.name in names:
            problem = f"robot {robot.id} has this DFPC twice, expected one entry"
            yield Finding(("robots", i, "dfpcs", j, "name"), problem, entry.name)
        names.add(entry.name)
        yield from _mode_findings(reading, robot, entry, ("robots", i, "dfpcs", j, "modes"))


def _unknown_limit(place: Location, limit: str) -> Finding:
    starting = [known for known in ROBOT_LIMITS if known.startswith(f"{limit}_")]
    nearest = starting[0] if len(starting) == 1 else nearest_name(limit, ROBOT_LIMITS)
    return Finding(place, f"unknown limit; expected {one_of(ROBOT_LIMITS)}", ABSENT, nearest)


def _mode_findings(reading: Reading, robot: Robot, entry: DfpcEntry, place: Location) -> Iterator[Finding]:
    """Yield the findings about sensors and modes that a DFPC needs."""
    for sensor_name, required in entry.modes.items():
        at = (*place, sensor_name)
        if reading.is_unreadable(*place[:2], "sensors", sensor_name):
            continue
        if sensor_name not in robot.sensors:
            yield unknown_name(at, sensor_name, f"sensor of {robot.id}", robot.sensors)
            continue
        modes = robot.sensors[sensor_name].modes
        if not isinstance(required, str):
            if required.max_rate_hz is not None and required.max_rate_hz < required.min_rate_hz:
                yield Finding(at, f"max_rate_hz {required.max_rate_hz:g} is less than min_rate_hz", ABSENT)
            elif not any(required.is_met_by(mode) for mode in modes.values()):
                offered = ", ".join(f"{name} ({_properties(mode)})" for name, mode in modes.items())
                yield Finding(at, f"no mode of {sensor_name} meets this; it has {offered}", ABSENT)
            continue
        for mode in mode_names(required):
            if mode not in modes:
                yield unknown_name(at, mode, f"mode of {sensor_name}", modes)
            elif not modes[mode].on or modes[mode].rate_hz == 0.0:
                streaming = [name for name, m in modes.items() if m.on and m.rate_hz != 0.0]
                problem = f"{sensor_name} does not stream in this mode; expected {one_of(streaming)}"
                yield Finding(at, problem, mode)


def _properties(mode: SensorMode) -> str:
    values = {"on": mode.on} | mode.model_dump(exclude_defaults=True, exclude={"doc", "on"})
    return ", ".join(f"{key} {value}" for key, value in values.items())


def _history_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the findings about robots and streams in the history policies."""
    profile = reading.profile
    assert profile is not None
    for k, policy in enumerate(profile.history):
        if policy.robot is not None and policy.robot not in profile.robot_ids:
            yield unknown_name(("history", k, "robot"), policy.robot, "robot", profile.robot_ids)
            continue
        robots = {i: r for i, r in enumerate(profile.robots) if policy.robot in (None, r.id)}
        if any(reading.is_unreadable("robots", i, "sensors", policy.sensor) for i in robots):
            continue
        sensors = {name: sensor for robot in robots.values() for name, sensor in robot.sensors.items()}
        streams = [
            stream
            for robot in robots.values()
            if policy.sensor in robot.sensors
            for stream in robot.sensors[policy.sensor].streams
        ]
        if policy.sensor not in sensors:
            yield unknown_name(("history", k, "sensor"), policy.sensor, "sensor", sensors)
        elif policy.stream not in streams:
            kind = f"stream of {policy.sensor}"
            yield unknown_name(("history", k, "stream"), policy.stream, kind, dict.fromkeys(streams))


def _retention_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the findings about product types, DFPCs and robots in the retention rules."""
    profile = reading.profile
    assert profile is not None
    products = [_ALL_PRODUCTS, *product_types()]
    sensors = (name for robot in profile.robots for name in robot.sensors)
    makers = dict.fromkeys([*Registry.default().dfpcs, *sensors, _DERIVED])
    for k, rule in enumerate(profile.retention):
        if rule.product not in products:
            yield unknown_name(("retention", k, "product"), rule.product, "product type", products)
        if rule.dfpc is not None and rule.dfpc not in makers:
            problem = "is no installed DFPC and no sensor; right if the DPM also stores its products"
            near = nearest_name(rule.dfpc, makers)
            yield Finding(("retention", k, "dfpc"), problem, rule.dfpc, near, "warning")
        if rule.robot is not None and (near := nearest_name(rule.robot, profile.robot_ids)):
            problem = "is no robot of this profile; right if the DPM also stores its products"
            if rule.robot not in profile.robot_ids:
                yield Finding(("retention", k, "robot"), problem, rule.robot, near, "warning")
