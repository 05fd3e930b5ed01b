# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``sensor-faults.md`` and ``orbit-scenarios.md``: sections of simulated scenarios, from their models."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from cdff_dev.generate.python_source import render
from cdff_dev.generate.reference.profile import model_sections, rows
from cdff_dev.simulate.faults.model import Faults
from cdff_dev.simulate.orbit.scenario import OrbitScenario

#: Sign of each bound of JSON Schema.
_BOUNDS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}


def page() -> str:
    """Return the page of the section ``faults`` of a scenario."""
    return render("sensor_faults.md.j2", sections=_sections(Faults))


def orbit_page() -> str:
    """Return the page of the fields of a scenario in orbit."""
    return render("orbit_scenarios.md.j2", sections=_sections(OrbitScenario))


def _sections(model: type[BaseModel]) -> list[tuple[str, str, list[tuple[str, str, str, str, str]]]]:
    """Return the name, the description and the fields of a model and of the models in its fields."""
    return [
        (
            name,
            " ".join(section.get("description", "").replace("\n\n", "\0").split()).replace("\0", "\n\n"),
            [
                (field, type_, default, _range(section["properties"][field]), meaning)
                for field, type_, default, meaning in rows(section)
            ],
        )
        for name, section in model_sections(model)
    ]


def _range(field: dict[str, Any]) -> str:
    """Return the bounds of a number."""
    return ", ".join(f"{sign} {field[key]:g}" for key, sign in _BOUNDS.items() if key in field)
