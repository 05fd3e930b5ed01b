# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROCK: tasks of the robot, the bus, and what passes between them."""

from __future__ import annotations

import threading
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from services.corba.giop import Connections
from services.corba.naming import NameService
from services.gateway_rock.ports import RockInput, RockOutput
from services.gateway_rock.request_task import RequestServer
from services.gateway_rock.settings import RockSettings
from services.gateways.frames import FrameNames

SERVICE = "gateway_rock"
#: Interval of the status, and time in which a thread ends, seconds.
_STATUS_S, _JOIN_S = 1.0, 2.0


class Gateway:
    """Gateway between the bus and a robot with ROCK.

    Parameters
    ----------
    settings : RockSettings
    bus : Bus
    client : Client
        For requests; a connection to the bus of its own.
    host : str
    port : int
        Address of the robot's name service.
    own_host : str
        Address by which the robot reaches the gateway for requests.
    """

    def __init__(
        self,
        settings: RockSettings,
        bus: Bus,
        client: Client,
        host: str,
        port: int,
        own_host: str = "127.0.0.1",
    ) -> None:
        self._settings, self._bus = settings, bus
        self._address, self._is_closing = f"{host}:{port}", False
        self._connections: list[Connections] = []
        names = FrameNames(settings.robot, settings.frames)
        self._inputs = [RockInput(entry, names, self._names(host, port), bus) for entry in settings.inputs]
        self._outputs = [RockOutput(entry, names, self._names(host, port)) for entry in settings.outputs]
        self._requests: RequestServer | None = None
        if settings.requests is not None:
            services = self._names(host, port)
            self._requests = RequestServer(settings.requests, settings.robot, client, own_host, services)
        for output in self._outputs:
            dfpc, product = output.entry.product.split("/")
            bus.subscribe(keys.product(settings.robot, dfpc, product), output.on_message)

    def run(self, stop: threading.Event) -> None:
        """Connect to the tasks, and publish the status every second until ``stop`` is set."""
        workers = self._workers()
        for worker in workers:
            worker.start()
        key = keys.gateway_status(self._settings.robot, SERVICE)
        try:
            while True:
                self._bus.publish_latched(key, self.status())
                if stop.wait(_STATUS_S):
                    return
        finally:
            self._is_closing = True
            for worker in workers:
                worker.stop()
            for worker in workers:
                worker.thread.join(_JOIN_S)
            for connections in self._connections:  # of tasks that do not answer
                connections.close()
            for link in self._inputs:
                link.link.close()

    def problem(self) -> str:
        """Return which thread has ended although the gateway runs, or an empty text."""
        threads = [worker.thread for worker in self._workers()]
        ended = [thread.name for thread in threads if thread.ident and not thread.is_alive()]
        return f"the thread of {ended[0]} has ended" if ended and not self._is_closing else ""

    def status(self) -> dict[str, Any]:
        """Return the message of the status key: state and counters of each port."""
        inputs, outputs = {}, []
        for link in self._inputs:
            entry, counters = link.entry, link.link.counters.to_map()
            lost = link.link.sensor.status.dropped
            counters["dropped"] |= {"bus": lost} if lost else {}
            inputs[f"{entry.task}.{entry.port}"] = {
                "type": entry.type,
                "stream": entry.stream,
                **link.connection(),
                **counters,
            }
        for output in self._outputs:
            written = output.entry
            outputs.append(
                {
                    "product": written.product,
                    "topic": f"{written.task}.{written.port}",
                    "type": written.type,
                    **output.connection(),
                    **output.counters.to_map(),
                }
            )
        asked = [] if self._requests is None else [self._requests.status()]
        return {"name_service": self._address, "inputs": inputs, "outputs": outputs, "requests": asked}

    def _workers(self) -> list[RockInput | RockOutput | RequestServer]:
        """Return the parts with threads of their own."""
        asked = [] if self._requests is None else [self._requests]
        return [*self._inputs, *self._outputs, *asked]

    def _names(self, host: str, port: int) -> NameService:
        """Return the name service with connections of its own, so that ports do not wait for each other."""
        connections = Connections()
        self._connections.append(connections)
        return NameService(host, port, connections)
