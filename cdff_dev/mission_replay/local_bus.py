# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The bus of a mission replay: the methods of ``cdff_common.bus.Bus`` within one process, in virtual time.

A call or message runs its handlers immediately, in the calling task, in the order of their declaration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from cdff_common.bus import Message, Reply, Request, keys, without_pauses
from cdff_common.bus.message import pack
from cdff_common.clock import Clock
from cdff_common.errors import NoAnswerError

Handler = Callable[[Request], Any]


class LocalBus:
    """A bus that passes calls and messages to handlers and subscribers of the same process.

    Parameters
    ----------
    clock : Clock
        The mission clock.
    """

    def __init__(self, clock: Clock) -> None:
        self.mission_clock = clock
        self._handlers: dict[str, Handler] = {}
        self._subscribers: list[tuple[list[str], Callable[[Message], None]]] = []
        self._watchers: list[tuple[list[str], Callable[[str, bool], None]]] = []
        self._latched: dict[str, Message] = {}
        self._tokens: dict[str, None] = {}

    def publish(
        self, key: str, payload: bytes, *, encoding: str = "", attachment: bytes = b"", **_: Any
    ) -> None:
        """Pass a message to every subscriber of its key."""
        message, parts = Message(key, payload, encoding, attachment), key.split("/")
        for pattern, callback in list(self._subscribers):
            if _matches(pattern, parts):
                callback(message)

    def publish_map(self, key: str, body: Mapping[str, Any], **_: Any) -> None:
        """Publish a MessagePack map."""
        self.publish(key, pack(dict(body)), encoding="application/msgpack")

    def publish_latched(self, key: str, body: Mapping[str, Any], **_: Any) -> None:
        """Publish a map that later subscribers receive too."""
        self._latched[key] = Message(key, pack(dict(body)), "application/msgpack", b"")
        self.publish_map(key, body)

    def subscribe(self, keyexpr: str, callback: Callable[[Message], None], **_: Any) -> None:
        """Call ``callback`` for every message with a matching key, immediately for latched messages."""
        pattern = keyexpr.split("/")
        self._subscribers.append((pattern, callback))
        for key, message in list(self._latched.items()):
            if _matches(pattern, key.split("/")):
                callback(message)

    def serve(self, key: str, handler: Handler, **_: Any) -> None:
        """Answer calls of a key, or of all keys that match a key expression."""
        self._handlers[key] = handler

    def call_stream(
        self,
        key: str,
        parameters: Mapping[str, object] | None = None,
        *,
        payload: bytes = b"",
        encoding: str = "",
        attachment: bytes = b"",
        **_: Any,
    ) -> Iterator[Reply]:
        """Yield the replies of a call.

        Raises the errors of its handler, and NoAnswerError if there is none.
        """
        handler = self._handlers.get(key) or self._matching(key.split("/"))
        if handler is None:
            raise NoAnswerError(f"{key}: no service answers")
        request = Request(
            key, {n: str(v) for n, v in (parameters or {}).items()}, payload, encoding, attachment
        )
        replies = handler(request)
        yield from [replies] if isinstance(replies, Reply) else without_pauses(replies)

    def call(self, key: str, parameters: Mapping[str, object] | None = None, **more: Any) -> Reply:
        """Return the final reply of a call."""
        return [*self.call_stream(key, parameters, **more)][-1]

    def _matching(self, parts: list[str]) -> Handler | None:
        return next(
            (h for k, h in self._handlers.items() if "*" in k and _matches(k.split("/"), parts)), None
        )

    def declare_alive(self, scope: str, service: str) -> None:
        """Declare that a service of a scope is alive."""
        key = keys.alive(scope, service)
        self._tokens[key] = None
        for pattern, callback in list(self._watchers):
            if _matches(pattern, key.split("/")):
                callback(key, True)

    def alive(self, keyexpr: str, **_: Any) -> set[str]:
        """Return the liveliness tokens that match."""
        return {key for key in self._tokens if _matches(keyexpr.split("/"), key.split("/"))}

    def watch_alive(self, keyexpr: str, callback: Callable[[str, bool], None]) -> None:
        """Call ``callback`` for every matching token, immediately for existing tokens."""
        self._watchers.append((keyexpr.split("/"), callback))
        for key in list(self._tokens):
            if _matches(keyexpr.split("/"), key.split("/")):
                callback(key, True)


def _matches(pattern: list[str], parts: list[str]) -> bool:
    return len(pattern) == len(parts) and all(a in ("*", b) for a, b in zip(pattern, parts, strict=True))
