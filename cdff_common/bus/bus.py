# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bus of one process: a session and its declarations, closed in reverse order."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self, Unpack

import zenoh

from cdff_common.bus import keys, rpc
from cdff_common.bus.foreign import ForeignBus
from cdff_common.bus.handler_pool import HandlerPool, waiting
from cdff_common.bus.identity import Identity
from cdff_common.bus.message import Message, Reply, encoding_argument, key_argument, on_map, pack
from cdff_common.bus.qos import Qos
from cdff_common.bus.session import open_client, open_router
from cdff_common.bus.subscription import Subscription
from cdff_common.bus.verbs import RPC, VerbTable
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.loops import Loops
from cdff_common.mission_clock import MissionClock

logger = logging.getLogger(__name__)

#: Longest time to wait for a session to close; then a warning is logged.
_CLOSE_DEADLINE_S = 3.0
#: Time for running handlers to answer when the bus closes, seconds.
_ANSWER_S = 0.5


class Bus:
    """Connection of a process to the router.

    Use as a context manager: an unclosed session with a subscriber keeps the interpreter from exiting.

    Parameters
    ----------
    session : zenoh.Session
        Opened by ``Bus.open``.
    name : str
        Name of the process, for logs.

    Attributes
    ----------
    loops : Loops
        Threads of the subscriptions, and calls with a limited duration.
    """

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self._session = session
        self.loops = Loops()
        self._calls = rpc.CallResources(self.loops)
        self._name = name
        self._lock = threading.Lock()
        self._declarations: list[Any] = []
        self._latched: dict[str, Mapping[str, Any]] = {}
        self._clock: MissionClock | None = None
        self._verb_tables: dict[str, VerbTable] = {}
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._announced = False

    @classmethod
    def open(
        cls,
        connect: str | None = None,
        *,
        name: str,
        wait_s: float | None = 5.0,
        stop: threading.Event | None = None,
        identity: Identity | None = None,
        is_anonymous: bool = False,
    ) -> Self:
        """Connect to the router (argument, ``CDFF_CONNECT`` or the default), trying for ``wait_s`` seconds.

        ``wait_s=None`` tries until the router answers or ``stop`` is set. The default ``identity`` is that of
        ``CDFF_IDENTITY``; ``is_anonymous`` connects without one, to the router of another system.

        Raises
        ------
        UnavailableError
            If no router answers in time, or ``stop`` was set before.
        """
        return cls(open_client(connect, wait_s, stop, identity, is_anonymous=is_anonymous), name)

    @classmethod
    def open_router(cls, listen: str, *, uplink: str | None = None, name: str = "router") -> Self:
        """Open a router that listens on ``listen`` and links to the router at ``uplink`` while that is
        reachable, with the identity of ``CDFF_IDENTITY``.
        """
        return cls(open_router(listen, uplink, Identity.of_environment()), name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Answer the open calls, undeclare everything, newest first, and close the session; never longer than
        a few seconds.
        """
        with self._lock:
            declarations, self._declarations = self._declarations[::-1], []
        servers = [d for d in declarations if isinstance(d, rpc.CallServer)]
        for server in servers:
            server.stop()
        until_s = monotonic_s() + _ANSWER_S
        for server in servers:
            server.finish(until_s)
        closer = threading.Thread(target=self._close_all, args=(declarations,), name="bus close", daemon=True)
        closer.start()
        closer.join(_CLOSE_DEADLINE_S)
        if closer.is_alive():
            logger.warning("%s: the session did not close within %g s", self._name, _CLOSE_DEADLINE_S)

    def _close_all(self, declarations: list[Any]) -> None:
        for declaration in declarations:
            try:
                declaration.close() if hasattr(declaration, "close") else declaration.undeclare()
            except zenoh.ZError as error:
                logger.debug("closing %r: %s", declaration, error)
        self._calls.close()
        self._session.close()

    def _add_declaration(self, declaration: Any) -> Any:
        with self._lock:
            self._declarations.append(declaration)
        return declaration

    def publish(
        self,
        key: str,
        payload: bytes | bytearray,
        *,
        encoding: str = "",
        attachment: bytes = b"",
        qos: Qos = Qos.PRODUCT,
    ) -> None:
        """Publish one message.

        Raises
        ------
        InputError
            If key or encoding cannot be sent.
        UnavailableError
            If the bus is closed.
        """
        priority, congestion_control, express = qos.value
        try:
            self._session.put(
                key_argument(key),
                payload,
                encoding=encoding_argument(encoding),
                attachment=attachment or None,
                priority=priority,
                congestion_control=congestion_control,
                express=express,
            )
        except zenoh.ZError as error:
            raise UnavailableError(f"{key} is not published: {error}") from error

    def publish_map(self, key: str, body: Mapping[str, Any], *, qos: Qos = Qos.CONTROL) -> None:
        """Publish a MessagePack map, such as an event or a clock tick."""
        self.publish(key, pack(body), encoding="application/msgpack", qos=qos)

    def publish_latched(self, key: str, body: Mapping[str, Any]) -> None:
        """Publish a MessagePack map and keep it for late joiners, which ``call`` the same key."""
        with self._lock:
            is_new = key not in self._latched
            self._latched[key] = dict(body)
        if is_new:
            self.serve(key, lambda request: Reply.of(self._latched[request.key]), workers=1)
        self.publish_map(key, body)

    def subscribe(
        self, keyexpr: str, callback: Callable[[Message], None], *, depth: int = 64
    ) -> Subscription:
        """Call ``callback`` for each message in a separate thread; at most ``depth`` messages wait, oldest
        dropped.
        """
        subscription: Subscription = self._add_declaration(
            Subscription(self._session, keyexpr, callback, depth, self.loops)
        )
        return subscription

    def serve(
        self,
        key: str,
        handler: rpc.Handler,
        *,
        workers: int = 4,
        backlog: int = 64,
        busy_limit_s: float | None = None,
        pool: ThreadPoolExecutor | HandlerPool | None = None,
        stands_in: bool = False,
    ) -> rpc.CallServer:
        """Answer calls of ``key`` with ``handler`` in a pool of ``workers`` threads, or in ``pool``.

        Further ``backlog`` calls wait for a thread, or are paused by their handlers (``pause.Pause``). A call
        that takes longer than ``busy_limit_s`` is a problem of ``loops``. A server that ``stands_in`` answers
        only while no other process serves the prefix of the verb.
        """
        prefix, is_verb, verb = key.partition(RPC)
        session = None if is_verb else self._session
        work = None if busy_limit_s is None else self.loops.add_parallel(f"call {key}", busy_limit_s)
        server: rpc.CallServer = self._add_declaration(
            rpc.CallServer(session, key, handler, workers, backlog, self._calls, work, pool)
        )
        if is_verb:
            self._verb_table(prefix, stands_in).add(verb, server)
        return server

    def _verb_table(self, prefix: str, stands_in: bool) -> VerbTable:
        """Return the table of the verbs under a prefix, created at the first call."""
        with self._lock:
            table = self._verb_tables.get(prefix)
            if table is None:
                table = VerbTable(
                    self._session, self._calls, prefix, lambda: self._announced, complete=not stands_in
                )
                self._verb_tables[prefix] = table
                self._declarations.append(table)
        return table

    def call_stream(
        self,
        key: str,
        parameters: Mapping[str, object] | None = None,
        **options: Unpack[rpc.CallOptions],
    ) -> Iterator[Reply]:
        """Yield the replies to a call, the final one last; raises the errors of ``rpc.call_stream``."""
        return rpc.call_stream(self._session, key, parameters, **options)

    def call(
        self,
        key: str,
        parameters: Mapping[str, object] | None = None,
        **options: Unpack[rpc.CallOptions],
    ) -> Reply:
        """Return the final reply to a call; raises the errors of ``rpc.call_stream``."""
        with waiting():
            *_, final = self.call_stream(key, parameters, **options)
        return final

    def call_in_background(
        self,
        key: str,
        parameters: Mapping[str, object] | None,
        on_end: Callable[[Reply | CdffError], None],
        **options: Unpack[rpc.CallOptions],
    ) -> None:
        """Call, and pass the final reply or the error to ``on_end``; see ``rpc.call_in_background``."""
        rpc.call_in_background(self._session, key, parameters, on_end, **options)

    @property
    def foreign(self) -> ForeignBus:
        """Messages and calls of other systems in this session."""
        return ForeignBus(self._session, self._add_declaration, self.loops)

    @property
    def zid(self) -> str:
        """Id of the session in the network of Zenoh."""
        return str(self._session.zid())

    def declare_alive(self, scope: str, service: str) -> None:
        """Announce a service by its liveliness token; call it last, when the service can answer."""
        if not self.has_token(keys.alive(scope, service)):
            self.declare_token(keys.alive(scope, service))
        self._announced = True

    def declare_token(self, key: str) -> None:
        """Declare a liveliness token on a key until ``withdraw_token`` or the end of this session."""
        self._tokens[key] = self._add_declaration(self._session.liveliness().declare_token(key))

    def has_token(self, key: str) -> bool:
        """Return True if this session has declared a liveliness token on a key."""
        return key in self._tokens

    def withdraw_token(self, key: str) -> None:
        """Undeclare the liveliness token on a key; without one nothing happens."""
        with self._lock:
            token = self._tokens.pop(key, None)
            if token is None or token not in self._declarations:
                return
            self._declarations.remove(token)
        token.undeclare()

    def alive(self, keyexpr: str, *, timeout_s: float = 2.0) -> set[str]:
        """Return the liveliness tokens that match now."""
        replies = self._session.liveliness().get(keyexpr, timeout=timeout_s)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    def watch_alive(self, keyexpr: str, callback: Callable[[str, bool], None]) -> None:
        """Call ``callback(key, is_alive)`` for existing tokens and for each that appears or disappears."""

        def on_change(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._add_declaration(self._session.liveliness().declare_subscriber(keyexpr, on_change, history=True))

    @property
    def mission_clock(self) -> MissionClock:
        """Mission clock, synchronised from its first use."""
        with self._lock:
            clock = self._clock
        return self.synchronise(MissionClock()) if clock is None else clock

    def synchronise(self, clock: MissionClock) -> MissionClock:
        """Let a clock follow the published mission time, and return it; a bus has one clock, the first."""
        with self._lock:
            if self._clock is not None:
                return self._clock
            self._clock = clock
        self.subscribe(
            keys.CLOCK,
            on_map(lambda _, tick: clock.on_tick(tick["now_ns"], tick["rate"])),
            depth=4,
        )
        return clock
