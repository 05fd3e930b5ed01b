# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mode of one sensor as the instrument control unit sets it, for the driver of the sensor."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import on_map
from cdff_common.errors import CdffError, InputError

logger = logging.getLogger(__name__)

#: Timeout of a call of the instrument control unit, seconds.
_CALL_S = 2.0


@dataclass(frozen=True, slots=True)
class ActiveMode:
    """Mode of a sensor.

    Attributes
    ----------
    name : str
        Name of the mode in the profile.
    on : bool
        True if the sensor delivers samples in this mode.
    rate_hz : float or None
        Samples per second.
    width_px, height_px, stereo, exposure
        Properties of the mode as in the profile (``SensorMode``); None if not stated.
    acquires : int or None
        Samples of a single acquisition; None in other modes.
    acquisition : int
        Number of the acquisition.
    parameters : mapping of str to float
        Parameters of the acquisition, such as ``pan_deg``.
    """

    name: str = "unknown"
    on: bool = True
    rate_hz: float | None = None
    width_px: int | None = None
    height_px: int | None = None
    stereo: bool | None = None
    exposure: str | None = None
    acquires: int | None = None
    acquisition: int = 0
    parameters: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def from_body(cls, body: Mapping[str, Any]) -> ActiveMode:
        """Return the mode in the body of ``event/sensor_mode``; raises InputError."""
        name, on, rate_hz = body.get("mode"), body.get("on"), body.get("rate_hz")
        if not isinstance(name, str) or not isinstance(on, bool):
            raise InputError(f"sensor mode {dict(body)!r}: expected mode: text and on: bool")
        if rate_hz is not None and not isinstance(rate_hz, int | float):
            raise InputError(f"sensor mode {dict(body)!r}: expected rate_hz: number or none")
        others = {key: body.get(key) for key in ("width_px", "height_px", "stereo", "exposure", "acquires")}
        number, parameters = body.get("acquisition", 0), body.get("parameters", {})
        if not isinstance(number, int) or not isinstance(parameters, Mapping):
            raise InputError(f"sensor mode {dict(body)!r}: expected acquisition: integer and parameters: map")
        rate = None if rate_hz is None else float(rate_hz)
        return cls(name, on, rate, acquisition=number, parameters=dict(parameters), **others)


#: Called with each new mode, in a thread of its own; it sets the device and may raise any exception.
OnMode = Callable[[ActiveMode], None]


class SensorModes:
    """Current mode of a sensor; until the instrument control unit answers it is ``ActiveMode()``, on.

    If ``on_mode`` raises, the sensor is reported to the unit as lost, with the message as the reason, so that
    plans use other sensors.
    """

    def __init__(self, bus: Bus, robot: str, sensor: str, on_mode: OnMode | None) -> None:
        self._bus, self._robot, self._sensor, self._on_mode = bus, robot, sensor, on_mode
        self.current = ActiveMode()
        self._bodies: queue.SimpleQueue[Mapping[str, Any] | bool | None] = queue.SimpleQueue()
        bus.subscribe(keys.event(robot, "sensor_mode"), on_map(self._on_event))
        self._thread = threading.Thread(target=self._run, name=f"modes {sensor}", daemon=True)
        self._thread.start()
        bus.watch_alive(keys.alive(robot, "icu"), self._on_unit)

    def close(self) -> None:
        """End the thread."""
        self._bodies.put(None)
        self._thread.join(_CALL_S)

    def report(self, lost: str) -> None:
        """Report to the unit that the sensor is lost for a reason; an empty text: it works again."""
        query = {"sensor": self._sensor, "lost": lost}
        self._bus.call(keys.icu_rpc(self._robot, "fault"), query, timeout_s=_CALL_S)

    def _on_event(self, _key: str, body: dict[str, Any]) -> None:
        if body.get("sensor") == self._sensor:
            self._bodies.put(body)

    def _on_unit(self, _key: str, is_alive: bool) -> None:
        if is_alive:
            self._bodies.put(True)

    def _run(self) -> None:
        while (item := self._bodies.get()) is not None:
            try:
                body = self._read() if isinstance(item, bool) else item
                self._set(ActiveMode.from_body(body), is_lost=bool(body.get("reason")))
            except CdffError as error:
                logger.warning("mode of %s/%s: %s", self._robot, self._sensor, error)

    def _read(self) -> Mapping[str, Any]:
        """Return the state of the sensor at the unit; raises InputError if it has no such sensor."""
        body = self._bus.call(keys.icu_rpc(self._robot, "modes"), timeout_s=_CALL_S).body()
        sensors = body["sensors"]
        if self._sensor not in sensors:
            raise InputError(
                f"the profile of {self._robot} has no sensor {self._sensor!r}; it has {', '.join(sensors)}"
            )
        state: Mapping[str, Any] = sensors[self._sensor]
        return state

    def _set(self, mode: ActiveMode, *, is_lost: bool) -> None:
        """Set the mode and call the handler of the device; an error of the handler is reported.

        The error of a sensor that is lost is only logged: the report could arrive after its recovery.
        """
        if mode == self.current:
            return
        self.current = mode
        if self._on_mode is None:
            return
        try:
            self._on_mode(mode)
        except Exception as error:  # noqa: BLE001  # code of a device may raise anything; it is reported
            logger.warning("%s/%s does not set mode %s: %s", self._robot, self._sensor, mode.name, error)
            if not is_lost:
                self.report(f"mode {mode.name}: {type(error).__name__} {error}")
