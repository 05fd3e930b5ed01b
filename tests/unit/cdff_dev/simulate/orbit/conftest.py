# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A short scenario in orbit with a small camera and a small lidar."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from cdff_common.interfaces.dfn import validated
from cdff_dev.simulate.orbit.scenario import OrbitScenario
from cdff_dev.simulate.orbit.world import OrbitWorld

_VALUES: dict[str, Any] = {
    "kind": "orbit",
    "name": "small",
    "seed": 5,
    "epoch": "2026-08-01T12:00:00Z",
    "orbit": {"semi_major_axis_m": 6_928_137.0, "inclination_deg": 51.6},
    "lighting": {"sun": {"phase_deg": 40.0, "clock_deg": 30.0}, "eclipse": False},
    "client": {
        "name": "client",
        "mesh": "satellite",
        "inertia_kg_m2": [160.0, 60.0, 190.0],
        "attitude": {"orientation_xyzw": [0.0, 0.0, 0.0, 1.0], "rate_deg_s": [1.0, 2.0, 0.5]},
    },
    "servicer": {
        "start_m": [-15.0, 0.0, 0.0],
        "path": [{"kind": "hold", "duration_s": 20.0}],
        "cameras": {
            "camera": {
                "rows": 96,
                "columns": 128,
                "focal_px": 160.0,
                "rate_hz": 0.1,
                "zero_point_e_s": 3000.0,
                "prnu": 0.0,
            }
        },
        "lidars": {
            "lidar": {"rows": 48, "columns": 64, "field_deg": [30.0, 24.0], "rate_hz": 0.1, "scan_s": 1.0}
        },
    },
}


def small_values(**changes: Any) -> dict[str, Any]:
    """Return the values of the scenario file; ``servicer__start_m=...`` changes ``servicer.start_m``."""
    values = copy.deepcopy(_VALUES)
    for path, value in changes.items():
        *parents, key = path.split("__")
        target = values
        for parent in parents:
            target = target.setdefault(parent, {})
        if value is None:
            target.pop(key, None)
        else:
            target[key] = value
    return values


def small_scenario(**changes: Any) -> OrbitScenario:
    """Return the scenario with changed values."""
    return validated(OrbitScenario, small_values(**changes), "small")


@pytest.fixture(scope="session")
def orbit_world() -> OrbitWorld:
    """The bodies of the unchanged scenario."""
    return OrbitWorld(small_scenario())
