# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The bus of one process: a session with everything declared on it, closed in order."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Any, Self

import zenoh

from cdff_common.bus import keys, rpc
from cdff_common.bus.message import Message, Reply, Request, pack, unpack
from cdff_common.bus.qos import Qos, put_options
from cdff_common.bus.session import open_client, open_router
from cdff_common.bus.subscription import Subscription
from cdff_common.bus.verbs import RPC, VerbTable
from cdff_common.clock import MissionClock
from cdff_common.errors import CdffError

logger = logging.getLogger(__name__)

_CLOSE_DEADLINE_S = 3.0


class Bus:
    """A process's connection to the router.

    Use as a context manager: an unclosed session with a subscriber keeps the interpreter from exiting.

    Parameters
    ----------
    session : zenoh.Session
        Opened by ``Bus.open``.
    name : str
        Of the process, for logs.
    """

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self._session = session
        self._name = name
        self._lock = threading.Lock()
        self._open: list[Any] = []
        self._latched: dict[str, Mapping[str, Any]] = {}
        self._clock: MissionClock | None = None
        self._verb_tables: dict[str, VerbTable] = {}
        self._announced = False

    @classmethod
    def open(
        cls,
        connect: str | None = None,
        *,
        name: str,
        wait_s: float | None = 5.0,
        stop: threading.Event | None = None,
    ) -> Self:
        """Connect to the router (argument, ``CDFF_CONNECT`` or the default), trying for ``wait_s`` seconds.

        ``wait_s=None`` tries until the router is there or ``stop`` is set.

        Raises
        ------
        UnavailableError
            If no router answers in time, or ``stop`` was set before.
        """
        return cls(open_client(connect, wait_s, stop), name)

    @classmethod
    def open_router(cls, listen: str, *, uplink: str | None = None, name: str = "router") -> Self:
        """Be the router, listening on ``listen``, linked to the one at ``uplink`` while that is in contact."""
        return cls(open_router(listen, uplink), name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: tuple[type[BaseException] | None, BaseException | None, TracebackType | None]) -> None:
        self.close()

    def close(self) -> None:
        """Undeclare everything, newest first, and close the session; never longer than a few seconds."""
        with self._lock:
            opened, self._open = self._open[::-1], []
        closer = threading.Thread(target=self._close_all, args=(opened,), name="bus close", daemon=True)
        closer.start()
        closer.join(_CLOSE_DEADLINE_S)
        if closer.is_alive():
            logger.warning("%s: the session did not close within %g s", self._name, _CLOSE_DEADLINE_S)

    def _close_all(self, opened: list[Any]) -> None:
        for item in opened:
            try:
                item.close() if hasattr(item, "close") else item.undeclare()
            except zenoh.ZError as error:
                logger.debug("closing %r: %s", item, error)
        self._session.close()

    def _keep(self, item: Any) -> Any:
        with self._lock:
            self._open.append(item)
        return item

    def publish(
        self,
        key: str,
        payload: bytes | bytearray,
        *,
        encoding: str = "",
        attachment: bytes = b"",
        qos: Qos = Qos.PRODUCT,
    ) -> None:
        """Publish one message."""
        self._session.put(key, payload, encoding=encoding or None, attachment=attachment or None, **put_options(qos))

    def publish_map(self, key: str, body: Mapping[str, Any], *, qos: Qos = Qos.CONTROL) -> None:
        """Publish a MessagePack map: events, the clock."""
        self.publish(key, pack(body), encoding="application/msgpack", qos=qos)

    def publish_latched(self, key: str, body: Mapping[str, Any], *, qos: Qos = Qos.CONTROL) -> None:
        """Publish a MessagePack map and keep it for late joiners, who ``call`` the same key."""
        with self._lock:
            new = key not in self._latched
            self._latched[key] = dict(body)
        if new:
            self.serve(key, self._answer_latched, workers=1)
        self.publish_map(key, body, qos=qos)

    def _answer_latched(self, request: Request) -> Reply:
        return Reply.of(self._latched[request.key])

    def subscribe(self, keyexpr: str, callback: Callable[[Message], None], *, depth: int = 64) -> Subscription:
        """Call ``callback`` for each message, in its own thread; beyond ``depth`` waiting the oldest is dropped."""
        subscription: Subscription = self._keep(Subscription(self._session, keyexpr, callback, depth))
        return subscription

    def serve(self, key: str, handler: rpc.Handler, *, workers: int = 4, backlog: int = 64) -> rpc.Served:
        """Answer calls of ``key`` with ``handler`` in a pool of ``workers`` threads."""
        prefix, is_verb, verb = key.partition(RPC)
        served: rpc.Served = self._keep(rpc.Served(None if is_verb else self._session, key, handler, workers, backlog))
        if is_verb:
            self._verb_table(prefix).add(verb, served)
        return served

    def _verb_table(self, prefix: str) -> VerbTable:
        with self._lock:
            table = self._verb_tables.get(prefix)
            if table is None:
                table = VerbTable(self._session, prefix, lambda: self._announced)
                self._verb_tables[prefix] = table
                self._open.append(table)
        return table

    def call_stream(
        self,
        key: str,
        parameters: Mapping[str, object] | None = None,
        *,
        payload: bytes = b"",
        encoding: str = "",
        attachment: bytes = b"",
        timeout_s: float = 5.0,
    ) -> Iterator[Reply]:
        """Yield the replies to a call, the final one last; raises as ``rpc.call_stream`` says."""
        return rpc.call_stream(
            self._session,
            key,
            parameters,
            payload=payload,
            encoding=encoding,
            attachment=attachment,
            timeout_s=timeout_s,
        )

    def call(
        self,
        key: str,
        parameters: Mapping[str, object] | None = None,
        *,
        payload: bytes = b"",
        encoding: str = "",
        attachment: bytes = b"",
        timeout_s: float = 5.0,
    ) -> Reply:
        """Return the final reply to a call; raises as ``rpc.call_stream`` says."""
        *_, final = self.call_stream(
            key, parameters, payload=payload, encoding=encoding, attachment=attachment, timeout_s=timeout_s
        )
        return final

    def declare_alive(self, scope: str, service: str) -> None:
        """Say that a service is there; do it last, when it can answer."""
        self.declare_token(keys.alive(scope, service))
        self._announced = True

    def declare_token(self, key: str) -> None:
        """Keep a liveliness token on a key for as long as this session lives."""
        self._keep(self._session.liveliness().declare_token(key))

    def alive(self, keyexpr: str, *, timeout_s: float = 2.0) -> set[str]:
        """Liveliness tokens that match now."""
        found = self._session.liveliness().get(keyexpr, timeout=timeout_s)
        return {str(reply.ok.key_expr) for reply in found if reply.ok is not None}

    def watch_alive(self, keyexpr: str, callback: Callable[[str, bool], None]) -> None:
        """Call ``callback(key, is_alive)`` for tokens that are there and whenever one comes or goes."""

        def on_change(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._keep(self._session.liveliness().declare_subscriber(keyexpr, on_change, history=True))

    @property
    def mission_clock(self) -> MissionClock:
        """The mission clock, followed from the first use on."""
        with self._lock:
            new = self._clock is None
            if self._clock is None:
                self._clock = MissionClock()
            clock = self._clock
        if new:
            self.subscribe(keys.CLOCK, self._on_tick, depth=4)
        return clock

    def _on_tick(self, message: Message) -> None:
        try:
            tick = unpack(message.payload)
            assert self._clock is not None
            self._clock.on_tick(int(tick["now_ns"]), float(tick["rate"]))
        except (CdffError, KeyError, TypeError, ValueError) as error:
            logger.warning("malformed tick on %s: %s", message.key, error)
