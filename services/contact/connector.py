# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attempts to open a session with the ground that overlap in time.

The handshake of Zenoh takes two round trips, and an attempt of which a packet is lost waits for its time
limit. A new attempt starts before the earlier ones have ended, and the first session that is open is used.
A session in which a declaration was lost passes no packets: another one is therefore opened meanwhile, until
the ground has answered.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

from cdff_common.bus.contact_session import ContactSession
from cdff_common.errors import CdffError, UnavailableError

logger = logging.getLogger(__name__)

#: Time between the starts of attempts, at first and after the first ones, seconds, and the number of these.
_PERIOD_S, _SLOW_PERIOD_S, _FAST_ATTEMPTS = 0.25, 1.0, 40
#: Attempts at the same time.
_MAX_ATTEMPTS = 12


class Connector:
    """Opens sessions in threads.

    Parameters
    ----------
    endpoint : str
        Zenoh endpoint of the ground.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._opened: queue.SimpleQueue[tuple[int, ContactSession | CdffError]] = queue.SimpleQueue()
        self._attempts_running: list[threading.Thread] = []
        self._closing: list[threading.Thread] = []
        self._spare: ContactSession | None = None
        self._round, self._attempts, self._next_s = 0, 0, 0.0

    def poll(self, now_s: float, delay_s: float) -> None:
        """Start an attempt if one is due and no session is open.

        Parameters
        ----------
        now_s : float
            Monotonic time.
        delay_s : float
            One-way delay of the link.

        Raises
        ------
        ConfigurationError
            If the endpoint and the identity of the process do not fit.
        """
        while not self._opened.empty():
            number, result = self._opened.get()
            if isinstance(result, UnavailableError):
                logger.debug("%s", result)
            elif isinstance(result, CdffError):
                raise result
            elif number == self._round and self._spare is None:
                self._spare = result
            else:
                self.discard(result)
        self._attempts_running = [thread for thread in self._attempts_running if thread.is_alive()]
        if self._spare is None and now_s >= self._next_s and len(self._attempts_running) < _MAX_ATTEMPTS:
            self._attempts += 1
            self._next_s = now_s + (_PERIOD_S if self._attempts <= _FAST_ATTEMPTS else _SLOW_PERIOD_S)
            self._attempts_running.append(self._start(self._attempt, self._round, delay_s))

    def take(self) -> ContactSession | None:
        """Return the open session; None if there is none yet."""
        session, self._spare = self._spare, None
        return session

    def stop(self) -> None:
        """Ignore the attempts that were started; their sessions are closed."""
        if self._attempts:
            self._round, self._attempts, self._next_s = self._round + 1, 0, 0.0
        self._discard_opened()
        if self._spare is not None:
            self.discard(self._spare)
            self._spare = None

    def discard(self, session: ContactSession) -> None:
        """Close a session in a thread of its own, because that can take half a second without an answer."""
        self._closing = [thread for thread in self._closing if thread.is_alive()]
        self._closing.append(self._start(session.close))

    def close(self) -> None:
        """Wait until all attempts have ended, at most for their time limit, and close their sessions."""
        self.stop()
        for thread in self._attempts_running:
            thread.join()
        self._discard_opened()
        for thread in self._closing:
            thread.join()

    def _discard_opened(self) -> None:
        while not self._opened.empty():
            _, result = self._opened.get()
            if isinstance(result, ContactSession):
                self.discard(result)

    @staticmethod
    def _start(function: Callable[..., None], *arguments: object) -> threading.Thread:
        thread = threading.Thread(target=function, args=arguments, name="contact session", daemon=True)
        thread.start()
        return thread

    def _attempt(self, number: int, delay_s: float) -> None:
        try:
            result: ContactSession | CdffError = ContactSession.connect(self._endpoint, delay_s)
        except CdffError as error:
            result = error
        self._opened.put((number, result))
