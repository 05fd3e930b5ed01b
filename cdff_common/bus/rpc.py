# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Remote calls: handlers in a bounded pool on one side, typed errors and a deadline on the other.

Every query gets at least one reply or one ``reply_err``, also when its service stops in an orderly way; no
reply at all means that no service is running, or that the network is lost (UNAVAILABLE).
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any, TypedDict, Unpack

import zenoh

from cdff_common import tracing
from cdff_common.bus.handler_pool import HandlerPool
from cdff_common.bus.inbox import Inbox
from cdff_common.bus.message import (
    Reply,
    Request,
    encoding_argument,
    error_body,
    error_of,
    format_parameters,
    key_argument,
    pack,
    parameters_of_malformed,
    parse_parameters,
    split_context,
    unpack,
    with_context,
)
from cdff_common.bus.pause import Pause, PausedCalls
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, DeadlineError, NoAnswerError, OverloadedError, UnavailableError
from cdff_common.loops import Loops, ParallelWork

logger = logging.getLogger(__name__)

#: Time after which a service that stops in an orderly way may be back, seconds.
STOPPING_RETRY_S = 1.0
#: Time in which a session removes a router whose link is lost, and interval of the checks, seconds.
_LINK_LOSS_S, _PAUSE_S = 0.2, 0.01
#: Default timeout of a call, seconds.
_TIMEOUT_S = 5.0

#: A handler may yield pauses between its replies, see ``pause``.
Handler = Callable[[Request], Reply | Iterable[Reply | Pause]]


class CallOptions(TypedDict, total=False):
    """Optional arguments of a call: payload with its encoding, attachment and timeout (5 s).

    With ``elsewhere``, servers of the calling process do not answer.
    """

    payload: bytes
    encoding: str
    attachment: bytes
    timeout_s: float
    elsewhere: bool


class CallResources:
    """Resources of all servers of one process.

    Attributes
    ----------
    inbox : Inbox
        Payloads of the calls.
    paused : PausedCalls
    refusals : ThreadPoolExecutor
        Answers calls that are refused: the threads of Zenoh, in which calls arrive, must not send.
    """

    def __init__(self, loops: Loops) -> None:
        self.inbox, self.paused = Inbox(), PausedCalls(loops)
        self.refusals = ThreadPoolExecutor(1, thread_name_prefix="refusals")

    def refuse(self, query: zenoh.Query, error: BaseException) -> None:
        """Answer a query with an error, in another thread."""

        def send() -> None:
            with query:
                refuse(query, error)

        try:
            self.refusals.submit(send)
        except RuntimeError as failure:  # the bus is closed, or the process has too many threads
            logger.warning("a call is not answered with %r: %s", str(error), failure)

    def close(self) -> None:
        """End the threads."""
        self.paused.close()
        self.refusals.shutdown(wait=False)


class CallServer:
    """Server that answers the calls of a key expression in its own thread pool.

    At most ``workers`` handlers run and ``backlog`` calls wait or pause, as far as the inbox holds their
    payloads; further calls are answered with OVERLOADED. Without a session it declares nothing; a
    ``VerbTable`` passes queries to ``enqueue``. ``work`` encloses each call. Several servers can share a
    ``pool``.
    """

    def __init__(
        self,
        session: zenoh.Session | None,
        key: str,
        handler: Handler,
        workers: int,
        backlog: int,
        resources: CallResources,
        work: ParallelWork | None = None,
        pool: ThreadPoolExecutor | HandlerPool | None = None,
    ) -> None:
        self._key = key
        self._resources, self._work = resources, work
        self._handler = handler
        self._slots = threading.BoundedSemaphore(workers + backlog)
        self._changed = threading.Condition()
        self._open: dict[int, zenoh.Query] = {}  # calls without a final answer, by ``id``
        self._stopping = False
        self._has_own_pool = pool is None
        self._pool = pool or ThreadPoolExecutor(workers, thread_name_prefix=f"rpc {key}")
        self._queryable = (
            None if session is None else session.declare_queryable(key, direct(self.enqueue), complete=True)
        )

    def stop(self) -> None:
        """Refuse further and waiting calls as UNAVAILABLE; running handlers continue."""
        with self._changed:
            self._stopping = True

    def finish(self, until_s: float) -> None:
        """Wait for running handlers (monotonic limit), then refuse the calls that are still open."""
        with self._changed:
            self._changed.wait_for(lambda: not self._open, max(until_s - monotonic_s(), 0.0))
            unanswered = list(self._open.values())
            self._open.clear()
        for query in unanswered:
            with query:
                refuse(query, self._stopping_error())

    def close(self) -> None:
        """Stop answering."""
        if self._queryable is not None:
            self._queryable.undeclare()
        if isinstance(self._pool, ThreadPoolExecutor) and self._has_own_pool:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def enqueue(self, query: zenoh.Query) -> None:
        """Answer a query in the pool, or with an error if the pool is full or the server stops."""
        with self._changed:
            error = self._stopping_error() if self._stopping else self._overload(query)
            if error is None:
                self._open[id(query)] = query
                self._pool.submit(self._advance, query, self._replies(query))
                return
        self._resources.refuse(query, error)

    def _overload(self, query: zenoh.Query) -> OverloadedError | None:
        """Take a slot and space for the payload of a query; return the error if there is none."""
        if not self._slots.acquire(blocking=False):
            return OverloadedError(f"{self._key}: too many calls at once")
        size = _payload_bytes(query)
        if self._resources.inbox.take(size):
            return None
        self._slots.release()
        return OverloadedError(f"{self._key}: {size >> 20} MB, and many others wait; repeat the call later")

    def _replies(self, query: zenoh.Query) -> Iterator[Reply | Pause]:
        if self._stopping:
            raise self._stopping_error()
        request, parent = _request_of(query)
        yield from tracing.traced(request.key, parent, self._handle(request))

    def _handle(self, request: Request) -> Iterator[Reply | Pause]:
        replies = self._handler(request)
        yield from [replies] if isinstance(replies, Reply) else replies

    def _advance(self, query: zenoh.Query, replies: Iterator[Reply | Pause]) -> None:
        """Send the replies up to the next pause, or to the end."""
        size = _payload_bytes(query)  # unknown once the query has ended
        with nullcontext() if self._work is None else self._work.piece():
            pause = self._send(query, replies)
        if pause is None:
            self._resources.inbox.release(size)
            self._slots.release()
        else:
            self._resources.paused.add(pause, lambda: self._proceed(query, replies))

    def _proceed(self, query: zenoh.Query, replies: Iterator[Reply | Pause]) -> None:
        size = _payload_bytes(query)
        try:
            self._pool.submit(self._advance, query, replies)
        except RuntimeError as failure:  # the pool is shut down, or the process has too many threads
            self._end(query, UnavailableError(f"{self._key} cannot be continued: {failure}"))
            self._resources.inbox.release(size)
            self._slots.release()

    def _send(self, query: zenoh.Query, replies: Iterator[Reply | Pause]) -> Pause | None:
        """Send replies; return the next pause, or end the query and return None."""
        error: Exception | None = None
        try:
            # The key of the query: a queryable on a wildcard answers with the caller's concrete key.
            key = str(query.key_expr)
            for reply in replies:
                if isinstance(reply, Pause):
                    return reply
                query.reply(
                    reply.key or key,
                    reply.payload,
                    encoding=encoding_argument(reply.encoding),
                    attachment=pack({"kind": "result", "final": True, **reply.attachment}),
                )
        except CdffError as raised:
            error = raised
        except Exception as raised:  # the caller receives INTERNAL rather than no answer
            if not self._stopping:
                logger.exception("handler of %s failed", self._key)
            error = raised
        self._end(query, error)
        return None

    def _end(self, query: zenoh.Query, error: Exception | None) -> None:
        """End a query that ``finish`` has not ended, with an error if there is one."""
        with self._changed:
            is_open = self._open.pop(id(query), None) is not None
        if is_open:
            with query:
                if error is not None:
                    refuse(query, error)
        with self._changed:
            self._changed.notify_all()

    def _stopping_error(self) -> UnavailableError:
        return UnavailableError(f"{self._key}: the service is stopping; repeat the call", STOPPING_RETRY_S)


def direct(callback: Callable[[zenoh.Query], None]) -> zenoh.handlers.Callback[zenoh.Query]:
    """Return a handler that calls back in the thread of Zenoh; otherwise each queryable has a thread."""
    return zenoh.handlers.Callback(callback, indirect=False)


def refuse(query: zenoh.Query, error: BaseException) -> None:
    """Answer a query with an error body."""
    parameters = parameters_of_malformed(str(query.parameters))
    query.reply_err(pack(error_body(error, parameters)), encoding="application/msgpack")


def _payload_bytes(query: zenoh.Query) -> int:
    return 0 if query.payload is None else len(query.payload)


def _request_of(query: zenoh.Query) -> tuple[Request, str]:
    """Return the call of a query, and the context of the span that it belongs to."""
    attachment, parent = split_context(b"" if query.attachment is None else query.attachment.to_bytes())
    request = Request(
        key=str(query.key_expr),
        parameters=parse_parameters(str(query.parameters)),
        payload=b"" if query.payload is None else query.payload.to_bytes(),
        encoding="" if query.encoding is None else str(query.encoding),
        attachment=attachment,
    )
    return request, parent


def _has_router(session: zenoh.Session) -> bool:
    """Return whether a router is connected after a query without a final reply.

    The loss of a link can end the query before the session removes the router; then it is removed soon after.
    """
    deadline_s = monotonic_s() + _LINK_LOSS_S
    while session.info.routers_zid():
        if monotonic_s() > deadline_s:
            return True
        time.sleep(_PAUSE_S)
    return False


def call_stream(
    session: zenoh.Session,
    key: str,
    parameters: Mapping[str, object] | None,
    **options: Unpack[CallOptions],
) -> Iterator[Reply]:
    """Yield the replies to a call as they arrive, the final one last.

    Raises
    ------
    InputError
        If key, parameters or encoding cannot be sent.
    NoAnswerError
        If no service answers, or the replies end before the final one.
    DeadlineError
        If ``timeout_s`` passes first.
    UnavailableError
        If the bus is closed.
    CdffError
        The class of the error code in the reply.
    """
    answered = False
    for item in _get(session, key, parameters, zenoh.handlers.DefaultHandler(), options):
        reply = _reply_of(item, key, options)
        answered = True
        yield reply
        if reply.final:
            return
    raise _no_final_reply(session, key, answered)


def call_in_background(
    session: zenoh.Session,
    key: str,
    parameters: Mapping[str, object] | None,
    on_end: Callable[[Reply | CdffError], None],
    **options: Unpack[CallOptions],
) -> None:
    """Call without a thread that waits: ``on_end`` gets the final reply, or the error of ``call_stream``.

    It is called once, in a thread of Zenoh, which it must not block. Other replies are ignored. Raises
    InputError or UnavailableError if the call cannot be sent.
    """
    answered = False
    is_over = False

    def end(result: Reply | CdffError) -> None:
        nonlocal is_over
        if not is_over:
            is_over = True
            on_end(result)

    def take(item: zenoh.Reply) -> None:
        nonlocal answered
        answered = True
        try:
            reply = _reply_of(item, key, options)
        except CdffError as error:
            end(error)
            return
        if reply.final:
            end(reply)

    def finish() -> None:
        if not is_over:
            reason = _BROKEN_OFF if answered else _NO_SERVICE
            end(NoAnswerError(f"{key}: {reason}"))

    _get(session, key, parameters, zenoh.handlers.Callback(take, finish, indirect=False), options)


_BROKEN_OFF = "the answer broke off before the final reply; is the service running?"
_NO_SERVICE = "no service answers; is the service running?"


def _get(
    session: zenoh.Session,
    key: str,
    parameters: Mapping[str, object] | None,
    handler: Any,
    options: CallOptions,
) -> Any:
    """Send a call; return the object through which its handler delivers the replies."""
    selector = key_argument(key) + (f"?{format_parameters(parameters)}" if parameters else "")
    try:
        return session.get(
            selector,
            handler,
            payload=options.get("payload") or None,
            encoding=encoding_argument(options.get("encoding", "")),
            attachment=with_context(options.get("attachment", b"")) or None,
            timeout=options.get("timeout_s", _TIMEOUT_S),
            consolidation=zenoh.ConsolidationMode.NONE,
            target=zenoh.QueryTarget.BEST_MATCHING,
            allowed_destination=(
                zenoh.Locality.REMOTE if options.get("elsewhere") else zenoh.Locality.DEFAULT
            ),
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
    except zenoh.ZError as error:
        raise UnavailableError(f"{key} is not called: {error}") from error


def _reply_of(item: zenoh.Reply, key: str, options: CallOptions) -> Reply:
    """Return a reply; raises the error that it carries."""
    if item.ok is None:
        assert item.err is not None
        data = item.err.payload.to_bytes()
        if data == b"Timeout":
            raise DeadlineError(f"{key}: no final answer within {options.get('timeout_s', _TIMEOUT_S):g} s")
        raise error_of(unpack(data))
    sample = item.ok
    attachment = unpack(sample.attachment.to_bytes()) if sample.attachment is not None else {}
    return Reply(sample.payload.to_bytes(), str(sample.encoding), attachment, str(sample.key_expr))


def _no_final_reply(session: zenoh.Session, key: str, answered: bool) -> NoAnswerError:
    """Return the error of a call whose replies ended before the final one."""
    if not _has_router(session):
        return NoAnswerError(f"{key}: the connection to the router is lost; the call may be repeated")
    return NoAnswerError(f"{key}: {_BROKEN_OFF if answered else _NO_SERVICE}")
