# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``CommitWatch`` of a database on a PostgreSQL server: notifications of commits, a session lock as lease.

Every transaction that writes notifies the channel, which PostgreSQL delivers after the commit. The lock
belongs to the connection of the watch: the server releases it when the process dies or loses the connection.
"""

from __future__ import annotations

import logging
import threading
from typing import Any, cast

import psycopg
from sqlalchemy import Engine
from sqlalchemy.exc import DatabaseError

from cdff_common.errors import CdffError, StorageError
from dpm_store.engine.commit_watch import ignore

logger = logging.getLogger(__name__)

#: Channel of the notifications.
CHANNEL = "cdff_commits"
#: Key of the lock of the process that maintains the store ("cdfm" in ASCII).
LEASE_LOCK = 0x6364666D
#: Interval of attempts to get the lease and to connect, and longest wait of the thread, seconds.
_RETRY_S, _WAIT_S = 0.5, 1.0
_OTHER = "another process maintains this store: the connection of this one to the database was lost"


class ServerWatch:
    """Thread that waits for notifications; it connects again if the connection is lost.

    Parameters
    ----------
    engine : Engine
    takes_lease : bool
        Whether this process maintains the store.

    Attributes
    ----------
    on_commit : callable
        Called after one or several commits, and after a new connection, because commits may have been missed.
    """

    def __init__(self, engine: Engine, *, takes_lease: bool) -> None:
        self.on_commit = ignore
        self._engine, self._takes_lease = engine, takes_lease
        self._closed, self._has_lease = threading.Event(), threading.Event()
        self._problem, self._is_connected = "", True
        self._thread = threading.Thread(target=self._run, name="commits", daemon=True)
        self._thread.start()

    def wait_for_lease(self, stop: threading.Event) -> bool:
        """Wait until this process has the lease; return False if stopped before.

        Raises
        ------
        StorageError
            If the thread of the watch has ended.
        """
        if not self._has_lease.wait(_WAIT_S):
            logger.info("another process maintains the store: this one waits until it ends")
        while not self._has_lease.wait(_RETRY_S):
            if stop.is_set():
                return False
            if reason := self.problem():
                raise StorageError(f"store: {reason}")
        return True

    def problem(self) -> str:
        """Return why this process must end; empty if it may work."""
        if not self._thread.is_alive() and not self._closed.is_set():
            return "the thread that follows the commits of other processes has ended"
        return self._problem

    def close(self) -> None:
        """Stop, and release the lease."""
        self._closed.set()
        self._thread.join(5.0 * _WAIT_S)

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                self._follow()
            except (psycopg.Error, DatabaseError, CdffError) as error:
                if self._is_connected:  # one line for each interruption, however long it lasts
                    logger.warning("commits of other processes are not followed: %s; connecting again", error)
                self._is_connected = False
                self._closed.wait(_RETRY_S)

    def _follow(self) -> None:
        """Follow the commits on one connection until the watch is closed."""
        pooled = self._engine.raw_connection()
        driver = cast("psycopg.Connection[Any]", pooled.driver_connection)
        pooled.detach()
        with driver:
            driver.autocommit = True
            if self._takes_lease and not self._lock(driver):
                return
            driver.execute(f"LISTEN {CHANNEL}".encode())
            self.on_commit()
            self._is_connected = True
            while not self._closed.is_set():
                if list(driver.notifies(timeout=_WAIT_S, stop_after=1)):
                    self.on_commit()

    def _lock(self, driver: psycopg.Connection[Any]) -> bool:
        """Get the lease for a connection; return False if the watch was closed before."""
        while not driver.execute("SELECT pg_try_advisory_lock(%s)", (LEASE_LOCK,)).fetchall()[0][0]:
            if self._has_lease.is_set():
                self._problem = _OTHER
            if self._closed.wait(_RETRY_S):
                return False
        self._has_lease.set()
        return True
