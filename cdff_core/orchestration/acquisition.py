# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Single acquisitions of a plan: a mode of a sensor with parameters, with its duration and energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.interfaces.sensor_profile import Sensor


@dataclass(frozen=True, slots=True)
class Acquisition:
    """A single acquisition of a sensor.

    Attributes
    ----------
    mode : str
        Mode for single acquisitions.
    parameters : AcquisitionParameters
    duration_s : float
        Seconds from the mode to the end of the acquisition, with the motion of the parameters.
    energy_j : float
        Joules.
    """

    mode: str
    parameters: AcquisitionParameters
    duration_s: float = 0.0
    energy_j: float = 0.0

    def describe(self) -> dict[str, Any]:
        """Return plain data for plans."""
        return {
            "mode": self.mode,
            "parameters": self.parameters.to_dict(),
            "duration_s": round(self.duration_s, 3),
            "energy_j": round(self.energy_j, 3),
        }


def acquisitions_of(
    sensor: Sensor, parameters: AcquisitionParameters, current: Mapping[str, float]
) -> dict[str, Acquisition]:
    """Return the possible acquisitions of a sensor with some parameters, by mode.

    ``current`` are the values of the last acquisition.
    """
    values = parameters.to_dict()
    acquisitions = {}
    for name, mode in sensor.modes.items():
        if mode.acquires is not None and not mode.acquisition_fault(values):
            duration_s = mode.acquisition_s(values, current)
            energy_j = mode.acquisition_j(duration_s)
            acquisitions[name] = Acquisition(name, parameters, duration_s, energy_j)
    return acquisitions
