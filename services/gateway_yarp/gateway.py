# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to YARP: ports of the robot, the bus, and what passes between them."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import Any

from cdff_common.bus import Bus, keys
from services.gateway_yarp.ports import YarpInput, YarpOutput
from services.gateway_yarp.settings import YarpSettings
from services.yarp.names import NameServer

SERVICE = "gateway_yarp"
_STATUS_S = 1.0


class Gateway:
    """Gateway between the bus and a robot with YARP.

    Parameters
    ----------
    settings : YarpSettings
    bus : Bus
    names : NameServer
    host : str
        Address of this machine for the robot.
    """

    def __init__(self, settings: YarpSettings, bus: Bus, names: NameServer, host: str) -> None:
        self._settings, self._bus, self._names = settings, bus, names
        self._is_closing = False
        self._inputs = [
            YarpInput(entry, f"{settings.node}/{entry.stream}:i", names, settings.robot, host, bus)
            for entry in settings.inputs
        ]
        self._outputs = [
            YarpOutput(entry, f"{settings.node}/{entry.product}:o", names) for entry in settings.outputs
        ]
        self._ports: list[YarpInput | YarpOutput] = [*self._inputs, *self._outputs]
        for output in self._outputs:
            dfpc, product = output.entry.product.split("/")
            bus.subscribe(keys.product(settings.robot, dfpc, product), output.on_message)

    def run(self, stop: threading.Event) -> None:
        """Connect the ports, and publish the status every second until ``stop`` is set."""
        with ExitStack() as stack:
            for port in self._ports:
                stack.callback(port.close)
                port.start()
            while True:
                key = keys.gateway_status(self._settings.robot, SERVICE)
                self._bus.publish_latched(key, self.status())
                if stop.wait(_STATUS_S):
                    self._is_closing = True
                    return

    def problem(self) -> str:
        """Return which thread has ended although the gateway runs, or an empty text."""
        threads = [thread for port in self._ports for thread in port.threads]
        ended = [thread.name for thread in threads if thread.ident and not thread.is_alive()]
        return f"the thread {ended[0]!r} has ended" if ended and not self._is_closing else ""

    def status(self) -> dict[str, Any]:
        """Return the message of the status key: state and counters of each port."""
        inputs = {}
        for link in self._inputs:
            counters, entry = link.link.counters.to_map(), link.entry
            lost = link.link.sensor.status.dropped
            counters["dropped"] |= {"bus": lost} if lost else {}
            state = {"connected": link.is_connected, "last_error": link.last_error}
            name = f"{entry.port} {entry.stream}" if entry.port in inputs else entry.port
            inputs[name] = {"type": entry.content, "stream": entry.stream, **state, **counters}
        outputs = [
            {
                "product": output.entry.product,
                "topic": output.entry.port,
                "type": output.entry.content,
                "connected": output.is_connected,
                "last_error": output.last_error,
                **output.counters.to_map(),
            }
            for output in self._outputs
        ]
        address = f"{self._names.host}:{self._names.port}"
        return {"name_server": address, "inputs": inputs, "outputs": outputs, "requests": []}
