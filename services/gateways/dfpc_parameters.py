# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of DFPCs that a robot may read and set: ``lidar_slam.voxel_m`` is ``voxel_m`` of ``lidar_slam``.

A parameter is set by ``configure`` of its DFPC, which an active DFPC refuses.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import DeniedError, InputError, UnavailableError

_CALL_S = 5.0
#: Attempts to set parameters while other clients configure the DFPC.
_MAX_ATTEMPTS = 4


class DfpcParameters:
    """Listed parameters of the DFPCs of a robot.

    Parameters
    ----------
    robot : str
    allowed : mapping of DFPC to names
        Parameters that exist for the robot; a name of a DFN's parameter has that of its slot and a dot.
    bus : Bus
        Bus of the DFPCs.
    """

    def __init__(self, robot: str, allowed: Mapping[str, tuple[str, ...]], bus: Bus) -> None:
        self._robot, self._bus, self._lock = robot, bus, threading.Lock()
        self._allowed = {f"{dfpc}.{name}": (dfpc, name) for dfpc, names in allowed.items() for name in names}

    @property
    def names(self) -> list[str]:
        """Names with their DFPC, sorted."""
        return sorted(self._allowed)

    def value(self, name: str) -> Any:
        """Return the value of a parameter as plain data.

        Raises
        ------
        LookupError
            If it is not listed, or its DFPC has no such parameter.
        UnavailableError
            If its DFPC does not answer, or is not configured.
        """
        dfpc, inner = self._allowed[name]
        *path, last = inner.split(".")
        return _place(self._description(dfpc)["parameters"], path)[last]

    def set(self, values: Mapping[str, Any]) -> None:
        """Set parameters of one DFPC, all or none.

        Raises
        ------
        DeniedError
            If a parameter is not listed.
        InputError
            If they belong to several DFPCs, a value is not plain data, the DFPC refuses it, or other clients
            configure the DFPC at the same time in each of the attempts.
        NotActiveError
            If the DFPC is active.
        UnavailableError
            If the DFPC does not answer, or is not configured.
        """
        unknown = sorted(set(values) - set(self._allowed))
        if unknown:
            raise DeniedError(f"{unknown[0]}: not among the parameters of the gateway")
        dfpcs = sorted({self._allowed[name][0] for name in values})
        if len(dfpcs) != 1:
            raise InputError(f"parameters of {', '.join(dfpcs) or 'no DFPC'}: expected those of one")
        (dfpc,) = dfpcs
        with self._lock:
            current = self._description(dfpc)
            for _ in range(_MAX_ATTEMPTS - 1):
                try:
                    self._configure(dfpc, values, current)
                except InputError:
                    previous, current = current, self._description(dfpc)
                    if current["config_hash"] == previous["config_hash"]:
                        raise
                else:
                    return
            self._configure(dfpc, values, current)

    def _configure(self, dfpc: str, values: Mapping[str, Any], current: dict[str, Any]) -> None:
        """Configure a DFPC with values in place of those of a description; see ``set``."""
        # All parameters are stated: ``configure`` resets those that are not to the values of the profile.
        parameters = current["parameters"]
        for name, value in values.items():
            *path, last = self._allowed[name][1].split(".")
            place = _place(parameters, path)
            if last not in place:
                raise InputError(f"{name}: {dfpc} has no such parameter")
            place[last] = value
        try:
            payload = pack(parameters)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{', '.join(sorted(values))}: {error}; expected plain data") from error
        # With ``if_match`` the parameters that another client sets meanwhile are not overwritten.
        key = keys.dfpc_rpc(self._robot, dfpc, "configure")
        self._bus.call(key, {"if_match": current["config_hash"]}, payload=payload, timeout_s=_CALL_S)

    def _description(self, dfpc: str) -> dict[str, Any]:
        """Return the answer of ``describe``; raises UnavailableError if the DFPC is not configured."""
        key = keys.dfpc_rpc(self._robot, dfpc, "describe")
        body: dict[str, Any] = self._bus.call(key, timeout_s=_CALL_S).body()
        if body["state"] == "unconfigured":
            raise UnavailableError(f"{dfpc} of {self._robot} is not configured")
        return body


def _place(parameters: dict[str, Any], path: list[str]) -> dict[str, Any]:
    """Return the mapping at a path, or an empty one."""
    place: Any = parameters
    for part in path:
        place = place.get(part, {}) if isinstance(place, dict) else {}
    return place if isinstance(place, dict) else {}
