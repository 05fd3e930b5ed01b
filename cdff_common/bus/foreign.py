# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages and calls of other systems on Zenoh, with payloads and attachments of their own."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import zenoh
import zenoh.ext

from cdff_common.bus.message import Message, encoding_argument, key_argument
from cdff_common.bus.subscription import Subscription
from cdff_common.errors import UnavailableError
from cdff_common.loops import Loops

logger = logging.getLogger(__name__)

#: Refusals that wait to be sent; further refused calls end without an answer.
_MAX_REFUSALS = 64
#: Interval of the heartbeats of a caching publisher after a message, seconds.
_HEARTBEAT_S = 0.5


class CachingPublisher:
    """Publisher that sends its last messages to subscribers that join later.

    Parameters
    ----------
    session : zenoh.Session
    key : str
    depth : int
        Number of cached messages.
    """

    def __init__(self, session: zenoh.Session, key: str, depth: int) -> None:
        self._publisher = zenoh.ext.declare_advanced_publisher(
            session,
            key_argument(key),
            cache=zenoh.ext.CacheConfig(max_samples=depth),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S
            ),
            publisher_detection=True,
        )

    def publish(self, payload: bytes, *, encoding: str, attachment: bytes) -> None:
        """Publish a message."""
        self._publisher.put(payload, encoding=encoding_argument(encoding), attachment=attachment)

    def close(self) -> None:
        """Stop serving the cached messages."""
        self._publisher.undeclare()


class CachedSubscription(Subscription):
    """Subscription that first receives the cached messages of all its publishers, present and later."""

    def _declare(self, session: zenoh.Session, keyexpr: str) -> Any:
        return zenoh.ext.declare_advanced_subscriber(
            session,
            keyexpr,
            zenoh.handlers.Callback(self._take, indirect=False),
            history=zenoh.ext.HistoryConfig(
                detect_late_publishers=True, max_samples=self._depth, max_age=None
            ),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            subscriber_detection=True,
        )


class ForeignCall:
    """A call of another system, which is answered once, at any time and from any thread.

    Attributes
    ----------
    key : str
    payload, attachment : bytes
    """

    def __init__(self, query: zenoh.Query, on_end: Callable[[ForeignCall], None]) -> None:
        self._query: zenoh.Query | None = query
        self._on_end, self._lock = on_end, threading.Lock()
        self.key = str(query.key_expr)
        self.payload = b"" if query.payload is None else query.payload.to_bytes()
        self.attachment = b"" if query.attachment is None else query.attachment.to_bytes()

    def reply(self, payload: bytes, *, encoding: str, attachment: bytes) -> None:
        """Answer the call; nothing happens if it is answered."""
        checked_encoding = encoding_argument(encoding)
        self._answer(
            lambda query: query.reply(
                self.key, payload, encoding=checked_encoding, attachment=attachment or None
            )
        )

    def refuse(self, reason: str) -> None:
        """Answer the call with an error; nothing happens if it is answered."""
        self._answer(lambda query: _refuse(query, reason))

    def _answer(self, send: Callable[[zenoh.Query], None]) -> None:
        """End the call, and send its answer, unless there is one; the client can then call again at once."""
        with self._lock:
            query, self._query = self._query, None
        if query is None:
            return
        self._on_end(self)
        with query:
            send(query)


def _refuse(query: zenoh.Query, reason: str) -> None:
    query.reply_err(reason.encode(), encoding="text/plain")


class ForeignServer:
    """Server of calls of another system.

    Its handler answers a call, or keeps it and answers later; an exception of the handler refuses the call.

    Parameters
    ----------
    session : zenoh.Session
    key : str
    handler : callable
    workers : int
        Threads of the handler.
    limit : int
        Calls that are open at once; further ones are refused.
    max_bytes : int
        Largest payload; calls with more are refused.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        handler: Callable[[ForeignCall], None],
        workers: int,
        limit: int,
        max_bytes: int,
    ) -> None:
        self._key, self._handler, self._limit, self._max_bytes = key, handler, limit, max_bytes
        self._lock = threading.Lock()
        self._open: set[ForeignCall] = set()
        self._is_closed = False
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix=f"call {key}")
        # The threads of Zenoh, in which calls arrive, must not send.
        self._refusals = ThreadPoolExecutor(1, thread_name_prefix=f"refuse {key}")
        self._refusal_slots = threading.BoundedSemaphore(_MAX_REFUSALS)
        self._queryable = session.declare_queryable(
            key_argument(key), zenoh.handlers.Callback(self._enqueue, indirect=False), complete=True
        )

    def close(self) -> None:
        """Stop answering; open calls are refused."""
        self._is_closed = True
        self._queryable.undeclare()
        with self._lock:
            unanswered = list(self._open)
        for call in unanswered:
            call.refuse(f"{self._key}: the service is stopping")
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._refusals.shutdown(wait=False)

    def _enqueue(self, query: zenoh.Query) -> None:
        size = 0 if query.payload is None else len(query.payload)
        reason = f"{size} bytes, expected at most {self._max_bytes}" if size > self._max_bytes else ""
        call = None
        with self._lock:
            if len(self._open) >= self._limit:
                reason = reason or "too many calls at once"
            if not reason:
                call = ForeignCall(query, self._end)
                self._open.add(call)
        try:
            if call is not None:
                self._pool.submit(self._handle, call)
            elif self._refusal_slots.acquire(blocking=False):
                self._refusals.submit(self._send_refusal, query, f"{self._key}: {reason}")
            else:
                query.drop()
        except RuntimeError as error:  # the server is closed, or the process has too many threads
            # Without a thread the pool keeps the call for a later one, so that it still counts as open.
            logger.debug("%s: %s", self._key, error)
            if call is not None and self._is_closed:
                self._end(call)

    def _send_refusal(self, query: zenoh.Query, reason: str) -> None:
        try:
            with query:
                _refuse(query, reason)
        finally:
            self._refusal_slots.release()

    def _handle(self, call: ForeignCall) -> None:
        try:
            self._handler(call)
        except Exception as error:  # the caller receives an error rather than no answer
            logger.exception("handler of %s failed", self._key)
            call.refuse(f"{type(error).__name__}: {error}")

    def _end(self, call: ForeignCall) -> None:
        with self._lock:
            self._open.discard(call)


class ForeignBus:
    """Publishers, subscriptions and servers of another system in the session of a bus.

    Parameters
    ----------
    session : zenoh.Session
    add : callable
        Keeps a declaration until the bus closes.
    loops : Loops
    """

    def __init__(self, session: zenoh.Session, add: Callable[[Any], Any], loops: Loops) -> None:
        self._session, self._add, self._loops = session, add, loops

    def publisher(self, key: str, *, depth: int) -> CachingPublisher:
        """Return a publisher that caches its last messages."""
        publisher: CachingPublisher = self._add(CachingPublisher(self._session, key, depth))
        return publisher

    def subscribe_cached(
        self, keyexpr: str, callback: Callable[[Message], None], *, depth: int = 1
    ) -> CachedSubscription:
        """Call ``callback`` for the cached messages of publishers and for each further one."""
        subscription: CachedSubscription = self._add(
            CachedSubscription(self._session, keyexpr, callback, depth, self._loops)
        )
        return subscription

    def serve(
        self,
        key: str,
        handler: Callable[[ForeignCall], None],
        *,
        workers: int = 2,
        limit: int = 64,
        max_bytes: int = 1 << 20,
    ) -> ForeignServer:
        """Answer the calls of a key; see ``ForeignServer``."""
        server: ForeignServer = self._add(
            ForeignServer(self._session, key, handler, workers, limit, max_bytes)
        )
        return server

    def call(
        self, key: str, payload: bytes, *, encoding: str, attachment: bytes, timeout_s: float = 5.0
    ) -> Message:
        """Return the answer of the only server of a key.

        Raises
        ------
        UnavailableError
            If there is no answer in time, or it is an error.
        """
        replies = self._session.get(
            key_argument(key),
            payload=payload,
            encoding=encoding_argument(encoding),
            attachment=attachment,
            timeout=timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,
            target=zenoh.QueryTarget.ALL_COMPLETE,
        )
        reason = "no service answers"
        for reply in replies:
            if reply.ok is not None:
                sample = reply.ok
                found = b"" if sample.attachment is None else sample.attachment.to_bytes()
                return Message(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding), found)
            if reply.err is not None:
                reason = reply.err.payload.to_bytes().decode("utf-8", "replace")
        raise UnavailableError(f"{key}: {reason}")
