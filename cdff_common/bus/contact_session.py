# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A Zenoh session over the link between a robot and the ground, apart from the sessions of their buses.

Only the packets of the exchange use the link, so that they can be paced. Any endpoint of Zenoh is possible;
over ``udp/…`` packets can be lost, and each fits in a datagram.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Self

import zenoh

from cdff_common.bus.identity import Identity
from cdff_common.bus.session import contact_config
from cdff_common.errors import UnavailableError

#: Time limit of an attempt to connect, in addition to four one-way delays, seconds.
_ATTEMPT_S = 0.5


class ContactSession:
    """One end of the link: sends and receives packets by key."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[str, zenoh.Publisher] = {}

    @classmethod
    def listen(cls, endpoint: str) -> Self:
        """Open the end of the ground; with an identity, each robot can send only its own packets.

        Raises
        ------
        ConfigurationError
            If the endpoint and the identity do not fit, or the identity has no access-control list.
        UnavailableError
            If the endpoint cannot be listened on.
        """
        settings: dict[str, object] = {"listen/endpoints": [endpoint], "listen/exit_on_failure": True}
        if (identity := Identity.of_environment()) is not None:
            settings["access_control"] = identity.access_control()
        return cls._open(endpoint, settings, "is another process using it?")

    @classmethod
    def connect(cls, endpoint: str, delay_s: float = 0.0) -> Self:
        """Open the end of a robot; raises UnavailableError if the ground does not answer in time."""
        settings: dict[str, object] = {
            "listen/endpoints": [],
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int((_ATTEMPT_S + 4.0 * delay_s) * 1000),
            "connect/exit_on_failure": True,
        }
        return cls._open(endpoint, settings, "the next attempt follows")

    @classmethod
    def _open(cls, endpoint: str, settings: dict[str, object], remedy: str) -> Self:
        try:
            return cls(zenoh.open(contact_config(endpoint, settings, Identity.of_environment())))
        except zenoh.ZError as error:
            raise UnavailableError(f"link {endpoint}: {error}; {remedy}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the session."""
        self._session.close()

    def receive(self, key: str, callback: Callable[[str, bytes], None]) -> None:
        """Call ``callback`` with the key and the bytes of each packet."""
        self._session.declare_subscriber(
            key, lambda sample: callback(str(sample.key_expr), sample.payload.to_bytes())
        )

    def send(self, key: str, packet: bytes) -> None:
        """Send a packet at once; it is dropped if the link is not there."""
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self._session.declare_publisher(
                key,
                express=True,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        publisher.put(packet)
