# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The outbox: products on their way into the DPM, kept until acknowledged, bounded, drops counted."""

from __future__ import annotations

import errno
import logging
import threading

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError, CodecError, UnavailableError
from services.dfpc_host.spool import Parcel, Spool, Waiting, opened

logger = logging.getLogger(__name__)

_RETRY_S = 0.5
#: How often the DPM may break on a parcel before the others go first.
_FAILURES = 20
#: What this process is short of for the moment: a file cannot be opened, but nothing is wrong with it.
_SHORT = (errno.EMFILE, errno.ENFILE, errno.ENOMEM)
_PUT_TIMEOUT_S = 5.0
#: Slowest link on which a product still arrives: what a large one is given time for.
_SLOWEST_BYTES_S = 25_000


class Outbox:
    """Hands parcels to the DPM in order from a thread of its own.

    While the DPM is away, out of contact, its disk full or itself broken, parcels wait in the ``spool``, which the next
    process takes up where this one ends; one on which the DPM breaks again and again goes behind the others. What the
    DPM refuses (same id, other content; malformed) and files that cannot be read are counted in ``refused`` and logged:
    a retry would not help.
    """

    def __init__(self, bus: Bus, spool: Spool) -> None:
        self.refused = 0
        self.last_error = ""
        self._bus = bus
        self._spool = spool
        self._ready = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="outbox", daemon=True)
        self._thread.start()

    @property
    def pending(self) -> int:
        """Parcels not yet acknowledged."""
        return len(self._spool)

    @property
    def pending_bytes(self) -> int:
        """How much they are."""
        return self._spool.bytes

    @property
    def dropped(self) -> int:
        """Parcels that went for want of room."""
        return self._spool.dropped

    def put(self, parcel: Parcel) -> None:
        """Queue a parcel; it outlives this process once this returns."""
        with self._ready:
            self._spool.add(parcel)
            self._ready.notify()

    def close(self, drain_s: float = 1.0) -> None:
        """Stop, after at most ``drain_s`` seconds of handing over what is left; the rest waits for the next process."""
        with self._ready:
            self._ready.wait_for(lambda: not self._spool, timeout=drain_s)
            self._closed = True
            self._ready.notify_all()
        self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._spool or self._closed)
                if self._closed:
                    return
                waiting = self._spool.first()
            if self._deliver(waiting):
                with self._ready:
                    self._spool.done(waiting)
                    self._ready.notify_all()
            else:
                with self._ready:
                    if waiting.failures >= _FAILURES:
                        self._spool.postpone(waiting)
                    self._ready.wait_for(lambda: self._closed, timeout=_RETRY_S)

    def _deliver(self, waiting: Waiting) -> bool:
        """Hand a parcel over; whether it is done with."""
        try:
            parcel = opened(waiting)
        except FileNotFoundError:  # dropped meanwhile for want of room
            return True
        except (OSError, CodecError) as error:  # CodecError: half written as power was lost
            if isinstance(error, OSError) and error.errno in _SHORT:
                return self._wait("a product", error)
            return self._refuse(f"{error}; it is let go")
        what = f"{parcel.dfpc}/{parcel.port}"
        parameters = {"robot": parcel.robot, "dfpc": parcel.dfpc, "port": parcel.port, "product": parcel.product}
        try:
            self._bus.call(
                keys.dpm_rpc(parcel.robot, "put"),
                parameters,
                payload=parcel.payload,
                encoding=parcel.encoding,
                attachment=parcel.attachment,
                timeout_s=_PUT_TIMEOUT_S + len(parcel.payload) / _SLOWEST_BYTES_S,
            )
        except CdffError as error:
            if isinstance(error, UnavailableError) or error.retriable:
                return self._wait(what, error)
            if type(error) is CdffError:  # a bug in the DPM: another process of it may do better
                waiting.failures += 1
                return self._wait(what, error)
            return self._refuse(f"the DPM refused {what}: {error}")
        return True

    def _wait(self, what: str, error: Exception) -> bool:
        """Say why a parcel stays; always False: it is not done with."""
        if self.last_error != str(error):
            logger.warning("%s waits for the DPM: %s", what, error)
        self.last_error = str(error)
        return False

    def _refuse(self, reason: str) -> bool:
        """Count a parcel that is let go; always True: it is done with."""
        self.refused += 1
        self.last_error = reason
        logger.error("%s", reason)
        return True
