# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Task of the gateway whose operation ``requestProduct`` returns products (Orocos RTT 2.9)."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from cdff_common.client import Client
from cdff_common.clock import monotonic_s
from cdff_common.codecs.bitstream import wrap
from cdff_common.errors import CdffError, OverloadedError, rpc_code
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.giop import Reference, write_reference
from services.corba.naming import NameService
from services.corba.server import GiopServer, Operation, Servant, UserError
from services.corba.typecodes import AnyReader, TypeCode, write_any
from services.gateway_rock.settings import RequestTask
from services.gateways.counters import RateLimit, TopicCounters
from services.gateways.product_query import ProductQuery

logger = logging.getLogger(__name__)

OPERATION = "requestProduct"
_CONTEXT = "TaskContexts"
_TASK, _SERVICE, _PORTS = b"task", b"service", b"ports"
_STRING, _DOUBLE = TypeCode("string"), TypeCode("double")
_BYTES = TypeCode("sequence", element=TypeCode("octet"))
#: Name, type in RTT, and description of each argument; the last is an output.
_ARGUMENTS = (
    ("query", "/std/string", "product and parameters, such as type=dem;region=circle:0,0,10"),
    ("deadline_s", "/double", "longest time of the request; 0 for that of the gateway"),
    ("product", "/std/vector</uint8_t>", "the product in unaligned PER"),
)
_RESULT = "/std/string"
_DESCRIPTION = "Return the ASN.1 type of a product, and the product in the last argument"
#: ``CTaskState``: running.
_RUNNING = 5
#: Interval of the registration, also without a name service, seconds.
_REGISTER_S, _RETRY_S = 5.0, 0.5


class RequestServer:
    """Task in the name service of the robot, by which its programs request products.

    Parameters
    ----------
    entry : RequestTask
    robot : str
    client : Client
        Connection to the orchestrator.
    host : str
        Address to listen on, by which the robot reaches the gateway.
    names : NameService
    """

    def __init__(self, entry: RequestTask, robot: str, client: Client, host: str, names: NameService) -> None:
        self.entry, self.counters = entry, TopicCounters()
        self._query = ProductQuery(entry.products, entry.deadline_s, robot)
        self._client, self._names, self._rate = client, names, RateLimit(entry.max_hz)
        self._is_registered, self._last_error = False, ""
        objects: dict[bytes, Servant] = {_TASK: _Task(self), _SERVICE: _Service(self), _PORTS: _Ports()}
        self._server, self._stop = GiopServer(host, objects), threading.Event()
        title = f"registration of {entry.task}"
        self.thread = threading.Thread(target=self._keep_registered, name=title, daemon=True)

    def start(self) -> None:
        """Start the thread that registers the task."""
        self.thread.start()

    def stop(self) -> None:
        """Ask the thread to remove the task from the name service, and end the connections."""
        self._stop.set()
        self._server.close()

    def _keep_registered(self) -> None:
        """Register the task at intervals, so that it is known after a restart of the name service."""
        reference = self._server.reference(_TASK)
        while not self._stop.is_set():
            try:
                self._names.rebind(reference, _CONTEXT, self.entry.task)
            except CdffError as error:
                if self._is_registered or not self._last_error:
                    logger.warning("task %s is not registered: %s", self.entry.task, error)
                self._is_registered, self._last_error = False, str(error)[:300]
            else:
                self._is_registered, self._last_error = True, ""
            self._stop.wait(_REGISTER_S if self._is_registered else _RETRY_S)
        if self._is_registered:
            with suppress(CdffError):  # the name service has ended
                self._names.unbind(_CONTEXT, self.entry.task)

    def status(self) -> dict[str, Any]:
        """Return the state of the registration and the counters as plain data."""
        name = f"{self.entry.task}.{OPERATION}"
        state = {"connected": self._is_registered, "last_error": self._last_error}
        return {"name": name, "type": OPERATION, **state, **self.counters.to_map()}

    def reference(self, key: bytes) -> Reference:
        """Return the reference of an object of the task."""
        return self._server.reference(key)

    def request(self, query: str, deadline_s: float) -> tuple[str, bytes]:
        """Return ASN.1 type and content of a product in unaligned PER; raises CdffError."""
        start_s = monotonic_s()
        self.counters.receive(len(query))
        try:
            if not self._rate.admits(start_s):
                raise OverloadedError(f"{OPERATION}: more than {self.entry.max_hz:g} requests per second")
            wrapped = wrap(self._query.answer(query, deadline_s, self._client).value)
        except CdffError as error:
            reason = "rate" if isinstance(error, OverloadedError) else "request"
            if self.counters.drop(reason, f"{type(error).__name__}: {error}"):
                logger.warning("%s: refused: %s", OPERATION, error)
            raise
        self.counters.forward(monotonic_s() - start_s)
        return wrapped.type, bytes(wrapped.data)


def _texts(*texts: str) -> Operation:
    def add(_: CdrReader, results: CdrWriter) -> None:
        for text in texts:
            results.text(text)

    return add


def _text_list(*texts: str) -> Operation:
    def add(_: CdrReader, results: CdrWriter) -> None:
        results.number("ulong", len(texts))
        for text in texts:
            results.text(text)

    return add


def _number(kind: str, value: int) -> Operation:
    return lambda _, results: results.number(kind, value)


class _Task:
    """``CTaskContext``: a task that runs, and whose state its clients cannot change."""

    type_id = "IDL:RTT/corba/CTaskContext:1.0"

    def __init__(self, owner: RequestServer) -> None:
        self._owner = owner
        self.operations: Mapping[str, Operation] = {
            "getName": _texts(owner.entry.task),
            "getDescription": _texts("requests of products"),
            "getTaskState": _number("ulong", _RUNNING),
            **{name: _number("boolean", 1) for name in ("isActive", "isRunning", "isConfigured")},
            **{
                name: _number("boolean", 0)
                for name in (
                    *("configure", "start", "activate", "stop", "cleanup"),
                    *("inFatalError", "inRunTimeError", "hasPeer", "addPeer", "removePeer"),
                    *("connectPeers", "disconnectPeers", "connectPorts", "connectServices"),
                )
            },
            "getPeerList": _text_list(),
            "getProvider": self._reference(_SERVICE, {"", "this", owner.entry.task}),
            "getRequester": lambda _, results: write_reference(results, None),
            "ports": self._reference(_PORTS),
        }

    def _reference(self, key: bytes, names: set[str] | None = None) -> Operation:
        """Return an operation whose result is an object, or nil if its argument is not among ``names``."""

        def add(arguments: CdrReader, results: CdrWriter) -> None:
            is_known = names is None or arguments.text() in names
            write_reference(results, self._owner.reference(key) if is_known else None)

        return add


class _Ports:
    """``CDataFlowInterface`` without ports."""

    type_id = "IDL:RTT/corba/CDataFlowInterface:1.0"
    operations: Mapping[str, Operation] = {"getPorts": _text_list(), "getPortDescriptions": _text_list()}


class _Service:
    """``CService`` with one operation."""

    type_id = "IDL:RTT/corba/CService:1.0"

    def __init__(self, owner: RequestServer) -> None:
        self._owner = owner
        self.operations: Mapping[str, Operation] = {
            "getName": _texts("this"),
            "getServiceDescription": _texts("requests of products"),
            "getProviderNames": _text_list(),
            "hasService": _number("boolean", 0),
            "getService": lambda _, results: write_reference(results, None),
            "getOperations": _text_list(OPERATION),
            "getArity": self._of_operation(_number("ushort", len(_ARGUMENTS))),
            "getCollectArity": self._of_operation(_number("ushort", 2)),
            "getResultType": self._of_operation(_texts(_RESULT)),
            "getDescription": self._of_operation(_texts(_DESCRIPTION)),
            "getArguments": self._of_operation(_descriptions),
            "getArgumentType": self._of_operation(_type_of((_RESULT, *(a[1] for a in _ARGUMENTS)))),
            "getCollectType": self._of_operation(_type_of((_RESULT, _RESULT, _ARGUMENTS[-1][1]))),
            "checkOperation": self._of_operation(self._check),
            "callOperation": self._of_operation(self._call),
        }

    @staticmethod
    def _of_operation(operation: Operation) -> Operation:
        """Return an operation whose first argument is the name of the operation that is meant."""

        def check_name(arguments: CdrReader, results: CdrWriter) -> None:
            name = arguments.text()
            if name != OPERATION:
                raise UserError("IDL:RTT/corba/CNoSuchNameException:1.0", lambda writer: writer.text(name))
            operation(arguments, results)

        return check_name

    def _check(self, arguments: CdrReader, _: CdrWriter) -> None:
        self._arguments(arguments)

    def _call(self, arguments: CdrReader, results: CdrWriter) -> None:
        query, deadline_s = self._arguments(arguments)
        try:
            name, content = self._owner.request(query, deadline_s)
        except CdffError as error:
            what = f"{rpc_code(error)[0]}: {error}"[:1000]
            raise UserError("IDL:RTT/corba/CCallError:1.0", lambda writer: writer.text(what)) from error
        write_any(results, _STRING, name)
        results.number("ulong", len(_ARGUMENTS))
        write_any(results, _STRING, query)
        write_any(results, _DOUBLE, deadline_s)
        write_any(results, _BYTES, np.frombuffer(content, np.uint8))

    def _arguments(self, reader: CdrReader) -> tuple[str, float]:
        """Return query and deadline; raises UserError if number or type of the arguments is wrong."""
        any_reader = AnyReader()
        values = [any_reader.read(reader) for _ in range(reader.count(4))]
        if len(values) != len(_ARGUMENTS):
            raise UserError(
                "IDL:RTT/corba/CWrongNumbArgException:1.0", _numbers(len(_ARGUMENTS), len(values))
            )
        expected = "string", "double", "sequence"
        for i, ((kind, _), wanted) in enumerate(zip(values, expected, strict=True)):
            if kind.kind != wanted:
                raise UserError("IDL:RTT/corba/CWrongTypeArgException:1.0", _wrong_type(i, kind.kind))
        return str(values[0][1]), float(values[1][1])


def _numbers(*numbers: int) -> Callable[[CdrWriter], None]:
    def add(writer: CdrWriter) -> None:
        for number in numbers:
            writer.number("long", number)

    return add


def _wrong_type(index: int, received: str) -> Callable[[CdrWriter], None]:
    def add(writer: CdrWriter) -> None:
        writer.number("long", index + 1)
        writer.text(_ARGUMENTS[index][1])
        writer.text(received)

    return add


def _descriptions(_: CdrReader, results: CdrWriter) -> None:
    results.number("ulong", len(_ARGUMENTS))
    for name, kind, text in _ARGUMENTS:
        for part in (name, text, kind):
            results.text(part)


def _type_of(types: tuple[str, ...]) -> Operation:
    """Return an operation that returns a type by its number, from 0 for the result."""

    def add(arguments: CdrReader, results: CdrWriter) -> None:
        number = arguments.number("ushort")
        if number >= len(types):
            raise UserError("IDL:RTT/corba/CWrongArgumentException:1.0", _numbers(number, len(types) - 1))
        results.text(types[number])

    return add
