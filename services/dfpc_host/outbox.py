# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The outbox: products on their way into the DPM, retried until acknowledged, bounded, drops counted."""

from __future__ import annotations

import logging
import threading
from collections import deque
from dataclasses import dataclass

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError, UnavailableError

logger = logging.getLogger(__name__)

_RETRY_S = 0.5
_PUT_TIMEOUT_S = 5.0


@dataclass(frozen=True, slots=True)
class Parcel:
    """An encoded product."""

    robot: str
    dfpc: str
    port: str
    product: str
    payload: bytes
    encoding: str
    attachment: bytes


class Outbox:
    """Hands parcels to the DPM in order from a thread of its own.

    When the DPM is away, its disk full or itself broken, parcels wait; beyond ``capacity`` the oldest is dropped and
    counted in ``dropped``. What the DPM refuses (same id, other content; malformed) is counted in ``refused`` and
    logged: a retry would not help.
    """

    def __init__(self, bus: Bus, capacity: int = 256) -> None:
        self.dropped = 0
        self.refused = 0
        self.last_error = ""
        self._bus = bus
        self._capacity = capacity
        self._queue: deque[Parcel] = deque()
        self._ready = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="outbox", daemon=True)
        self._thread.start()

    @property
    def pending(self) -> int:
        """Parcels not yet acknowledged."""
        return len(self._queue)

    def put(self, parcel: Parcel) -> None:
        """Queue a parcel."""
        with self._ready:
            if len(self._queue) >= self._capacity:
                self._queue.popleft()
                self.dropped += 1
            self._queue.append(parcel)
            self._ready.notify()

    def close(self, drain_s: float = 1.0) -> None:
        """Stop, after at most ``drain_s`` seconds of handing over what is left."""
        with self._ready:
            self._ready.wait_for(lambda: not self._queue, timeout=drain_s)
            self._closed = True
            self._ready.notify_all()
        self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._queue or self._closed)
                if self._closed:
                    return
                parcel = self._queue[0]
            if self._deliver(parcel):
                with self._ready:
                    if self._queue and self._queue[0] is parcel:
                        self._queue.popleft()
                    self._ready.notify_all()
            else:
                with self._ready:
                    self._ready.wait_for(lambda: self._closed, timeout=_RETRY_S)

    def _deliver(self, parcel: Parcel) -> bool:
        parameters = {"robot": parcel.robot, "dfpc": parcel.dfpc, "port": parcel.port, "product": parcel.product}
        try:
            self._bus.call(
                keys.dpm_rpc(parcel.robot, "put"),
                parameters,
                payload=parcel.payload,
                encoding=parcel.encoding,
                attachment=parcel.attachment,
                timeout_s=_PUT_TIMEOUT_S,
            )
        except CdffError as error:
            # INTERNAL without a class of ours is a bug in the DPM: another process of it may do better.
            if isinstance(error, UnavailableError) or error.retriable or type(error) is CdffError:
                if self.last_error != str(error):
                    logger.warning("%s/%s waits for the DPM: %s", parcel.dfpc, parcel.port, error)
                self.last_error = str(error)
                return False
            self.refused += 1
            self.last_error = str(error)
            logger.error("the DPM refused %s/%s: %s", parcel.dfpc, parcel.port, error)
        return True
