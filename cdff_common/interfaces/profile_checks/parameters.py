# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the DFPCs of a profile and of the DFNs in their slots, against their models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from cdff_common.errors import ConfigurationError
from cdff_common.geodesy import body_names
from cdff_common.interfaces.description import DfpcDescription, DfpcImplementation
from cdff_common.interfaces.profile import DfpcEntry
from cdff_common.interfaces.profile_checks.expectations import in_words
from cdff_common.interfaces.profile_checks.faults import ABSENT, Finding, nearest_name, one_of, unknown_name
from cdff_common.interfaces.profile_checks.reading import Reading
from cdff_common.interfaces.profile_checks.wiring import description_of
from cdff_common.interfaces.registry import Registry
from cdff_common.interfaces.yaml_file import Location


def body_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the finding of a body that is neither known nor defined."""
    assert reading.profile is not None
    body = reading.profile.body
    if body.crs is None and body.radii_m is None and body.name not in body_names():
        yield unknown_name(("body", "name"), body.name, "body", body_names())


def parameter_findings(reading: Reading) -> Iterator[Finding]:
    """Yield the findings of all parameters; a DFPC whose libraries are not installed gives a warning."""
    assert reading.profile is not None
    for i, robot in enumerate(reading.profile.robots):
        for j, entry in enumerate(robot.dfpcs):
            description = description_of(entry.name)
            variant = None if description is None else _variant(description, entry.implementation)
            if description is None or variant is None:
                continue
            place: Location = ("robots", i, "dfpcs", j, "parameters")
            try:
                yield from _entry_findings(entry, description, variant, place)
            except ConfigurationError as error:
                problem = f"the parameters cannot be checked here: {error}"
                yield Finding(("robots", i, "dfpcs", j, "name"), problem, entry.name, "", "warning")


def _variant(description: DfpcDescription, name: str | None) -> DfpcImplementation | None:
    variants = description.implementations
    return next((v for v in variants if v.name == name), None) if name else variants[0]


def _entry_findings(
    entry: DfpcEntry, description: DfpcDescription, variant: DfpcImplementation, place: Location
) -> Iterator[Finding]:
    """Yield the findings about the parameters of a DFPC and of its DFN slots."""
    model = Registry.default().make_dfpc(entry.name).config_model()
    merged = {**variant.parameters, **entry.parameters}
    slots = {slot.dfn_id: slot for slot in variant.dfns}
    others = {slot.dfn_id for v in description.implementations for slot in v.dfns} - slots.keys()
    yield from _model_findings(model, merged, entry.parameters, place)
    for dfn_id, parameters in entry.parameters.items():
        if dfn_id in others:
            problem = f"implementation {variant.name} has no DFN of this name; expected {one_of(slots)}"
            yield Finding((*place, dfn_id), problem, ABSENT)
        elif dfn_id in slots and isinstance(parameters, dict):
            slot = slots[dfn_id]
            node = Registry.default().make_dfn(slot.name, slot.implementation)
            merged = {**slot.parameters, **parameters}
            yield from _model_findings(node.Config, merged, parameters, (*place, dfn_id))


def _model_findings(
    model: type[BaseModel], merged: dict[str, Any], given: dict[str, Any], place: Location
) -> Iterator[Finding]:
    """Yield the findings of the given values; values that the compound supplies are not missing."""
    try:
        model.model_validate(merged)
    except ValidationError as error:
        for e in error.errors():
            location = _in_values(given, e["loc"])
            if e["type"] != "missing" and (location or not e["loc"]):
                yield _parameter_finding(model, e, (*place, *location))


def _in_values(given: Any, location: tuple[int | str, ...]) -> Location:
    """Return the part of the location of an error that is in the given values."""
    place: Location = ()
    for key in location:
        try:
            given = given[key]
        except (KeyError, IndexError, TypeError):
            break
        place = (*place, key)
    return place


def _parameter_finding(model: type[BaseModel], error: ErrorDetails, location: Location) -> Finding:
    """Return the finding of an error of pydantic, with the nearest accepted name or value."""
    if error["type"] == "extra_forbidden":
        known = _keys_at(model, error["loc"][:-1])
        name = str(error["loc"][-1])
        problem = f"unknown parameter; expected {one_of(known)}"
        return Finding(location, problem, ABSENT, nearest_name(name, known))
    options = str(error.get("ctx", {}).get("expected", "")).replace(" or ", ", ").replace("'", "").split(", ")
    value = ABSENT if isinstance(error["input"], dict) else error["input"]
    nearest = nearest_name(value, options) if error["type"] == "literal_error" else ""
    return Finding(location, in_words(error["msg"]), value, nearest)


def _keys_at(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Return the parameters of a model, or of the model of one of its fields."""
    fields = model.model_fields
    for key in location:
        annotation = fields[str(key)].annotation if str(key) in fields else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        fields = annotation.model_fields
    return list(fields)
