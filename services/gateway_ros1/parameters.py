# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of DFPCs on the parameter server of ROS 1, below the name of the node of the gateway."""

from __future__ import annotations

import logging
import threading
from functools import partial
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, UnavailableError
from services.gateway_ros1.node import Ros1Node
from services.gateways.counters import TopicCounters
from services.gateways.dfpc_parameters import DfpcParameters

logger = logging.getLogger(__name__)

#: Interval of the attempts to set parameters whose DFPC was not available, seconds.
_RETRY_S = 1.0
#: Interval of the comparison of all values with those of their DFPCs, which ``configure`` resets, seconds.
_CHECK_S = 5.0


class ServerParameters:
    """Values of the parameter server that are set in DFPCs; a refused value is replaced on the server.

    A value whose DFPC is not available is set when the DFPC becomes available.

    Parameters
    ----------
    node : Ros1Node
    robot : str
    parameters : DfpcParameters
    bus : Bus
        Bus of the DFPCs.
    """

    def __init__(self, node: Ros1Node, robot: str, parameters: DfpcParameters, bus: Bus) -> None:
        self._node, self._parameters = node, parameters
        self.counters = TopicCounters()
        self._lock = threading.Lock()
        self._changed = threading.Event()
        self._values: dict[str, Any] = {}
        self._reported: dict[str, tuple[str, str]] = {}  # last problem of each name, with the value
        self._pending: set[str] = set()
        self._available: set[str] = set()
        self._dfpcs = {name: name.partition(".")[0] for name in parameters.names}
        for name in parameters.names:
            node.watch_parameter(self._key(name), partial(self._on_value, name))
        for dfpc in sorted(set(self._dfpcs.values())):
            bus.watch_alive(keys.alive(robot, dfpc), partial(self._on_alive, dfpc))

    def to_map(self) -> dict[str, Any]:
        """Return the names of the parameters, those that wait for their DFPC, and the counters."""
        with self._lock:
            pending = sorted(self._pending)
        return {"names": self._parameters.names, "pending": pending, **self.counters.to_map()}

    def retry(self, stop: threading.Event) -> None:
        """Set new and waiting values whenever their DFPC is available, until ``stop`` is set."""
        check_s = monotonic_s() + _CHECK_S
        while not stop.is_set():
            self._changed.wait(_RETRY_S)
            self._changed.clear()
            is_due = monotonic_s() >= check_s
            check_s = monotonic_s() + _CHECK_S if is_due else check_s
            with self._lock:
                self._pending |= set(self._values) if is_due else set()
                ready = sorted(name for name in self._pending if self._dfpcs[name] in self._available)
            for name in ready:
                self._apply(name)

    def _key(self, name: str) -> str:
        return f"{self._node.name}/{name.replace('.', '/')}"

    def _on_alive(self, dfpc: str, _: str, is_alive: bool) -> None:
        """Note whether a DFPC is available; after a restart it has the values of the profile."""
        with self._lock:
            if is_alive:
                self._available.add(dfpc)
            else:
                self._available.discard(dfpc)
                self._pending |= {name for name in self._values if self._dfpcs[name] == dfpc}

    def _on_value(self, name: str, value: Any) -> None:
        """Store a value; the thread of ``retry`` sets it, since calls may block."""
        self.counters.receive(0)
        with self._lock:
            self._values[name] = value
            self._pending.add(name)
            is_available = self._dfpcs[name] in self._available
        if not is_available:
            self._drop("unavailable", name, value, "its DFPC is not available")
        self._changed.set()

    def _apply(self, name: str) -> None:
        """Set the last value of a parameter; after a refusal the server has the value of the DFPC again."""
        with self._lock:
            self._pending.discard(name)
            value = self._values[name]
        try:
            if not _is_equal(self._parameters.value(name), value):
                self._parameters.set({name: value})
                self.counters.forward(0.0)
            self._reported.pop(name, None)
        except UnavailableError as error:
            self._repeat("unavailable", name, value, error)
        # TypeError: dates and binary data of XML-RPC cannot be compared with numbers.
        except (CdffError, LookupError, TypeError) as error:
            self._drop("refused", name, value, error)
            self._replace(name, value)

    def _replace(self, name: str, refused: Any) -> None:
        """Replace a refused value by that of the DFPC, here and on the server, unless a newer one exists."""
        try:
            value = self._parameters.value(name)
            with self._lock:
                if self._values[name] is not refused:
                    return
            self._node.master.call("setParam", self._key(name), value)
        except (CdffError, LookupError) as error:
            self._repeat("not_replaced", name, refused, error)
            return
        with self._lock:
            if self._values[name] is refused:
                self._values[name] = value

    def _repeat(self, reason: str, name: str, value: Any, error: Exception) -> None:
        """Report a failure, and let the value be applied again."""
        with self._lock:
            self._pending.add(name)
        self._drop(reason, name, value, error)

    def _drop(self, reason: str, name: str, value: Any, error: object) -> None:
        """Count and log a problem, once for each value."""
        if self._reported.get(name) == (reason, repr(value)):
            return
        self._reported[name] = (reason, repr(value))
        if self.counters.drop(reason, f"{name}: {error}"):
            logger.warning("%s: %s: %s", self._key(name), reason, error)


def _is_equal(first: Any, second: Any) -> bool:
    """Return whether two values are equal, other than True and 1."""
    return isinstance(first, bool) == isinstance(second, bool) and bool(first == second)
