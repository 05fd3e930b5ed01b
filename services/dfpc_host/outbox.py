# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The outbox: products queued for the DPM until acknowledged, with bounded size and counted drops."""

from __future__ import annotations

import errno
import logging
import threading

from cdff_common.bus import Bus, keys
from cdff_common.errors import (
    CdffError,
    CodecError,
    DeadlineError,
    NoAnswerError,
    OverloadedError,
    UnavailableError,
)
from cdff_common.loops import Loop
from services.dfpc_host.spool import Spool, SpooledProduct, SpoolEntry

logger = logging.getLogger(__name__)

_RETRY_S = 0.5
#: Failures of the DPM on one product after which the product moves to the end of the queue.
_FAILURES = 20
#: Errors of a temporary shortage in this process; the file itself is intact.
_SHORTAGES = (errno.EMFILE, errno.ENFILE, errno.ENOMEM)
_PUT_TIMEOUT_S = 5.0
#: Slowest supported link, bytes/s; extends the timeout for large products.
_SLOWEST_BYTES_S = 25_000


class Outbox:
    """Thread that puts products into the DPM in order.

    While the DPM is unreachable, its disk full or failing, or its clock behind the stamps of the products,
    they stay in the ``spool``, which the next process continues. A product on which the DPM fails repeatedly
    moves to the end of the queue. Products
    that the DPM refuses (same id with other content; malformed) and unreadable files are counted in
    ``refused`` and logged, since a retry would not help.

    Parameters
    ----------
    bus : Bus
    spool : Spool
    loop : Loop
        Health of the thread.

    Attributes
    ----------
    spool : Spool
        Products that are not yet acknowledged.
    """

    def __init__(self, bus: Bus, spool: Spool, loop: Loop) -> None:
        self.refused = 0
        self.last_error = ""
        self._bus = bus
        self.spool = spool
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(
            target=loop.run, args=(self._next, self._send), name="outbox", daemon=True
        )
        self._thread.start()

    def put(self, product: SpooledProduct) -> None:
        """Queue a product; it survives the end of this process once this returns."""
        with self._changed:
            self.spool.add(product)
            self._changed.notify()

    def close(self, drain_s: float = 1.0) -> None:
        """Stop after at most ``drain_s`` seconds of delivery; the next process delivers the rest."""
        with self._changed:
            self._changed.wait_for(lambda: not self.spool, timeout=drain_s)
            self._closed = True
            self._changed.notify_all()
        self._thread.join(timeout=1.0)
        with self._changed:
            self.spool.write_out()

    def _next(self) -> SpoolEntry | None:
        with self._changed:
            self._changed.wait_for(lambda: self.spool or self._closed)
            return None if self._closed else self.spool.first()

    def _send(self, entry: SpoolEntry) -> None:
        """Deliver a product, or wait for the next attempt, also after an unexpected error."""
        is_done = False
        try:
            is_done = self._deliver(entry)
        except Exception:
            entry.failures += 1
            raise
        finally:
            with self._changed:
                if is_done:
                    self.spool.remove(entry)
                    self._changed.notify_all()
                else:
                    self._pause(entry)

    def _pause(self, entry: SpoolEntry) -> None:
        if entry.failures >= _FAILURES:
            self.spool.postpone(entry)
        if self.spool.in_memory:
            self.spool.write_out()
        self._changed.wait_for(lambda: self._closed, timeout=_RETRY_S)

    def _deliver(self, entry: SpoolEntry) -> bool:
        """Send a product to the DPM; return whether its file can be removed (stored, refused or dropped)."""
        try:
            product = entry.read()
        except FileNotFoundError:  # dropped meanwhile because the spool was full
            return True
        except (OSError, CodecError) as error:  # CodecError: half written when power was lost
            if isinstance(error, OSError) and error.errno in _SHORTAGES:
                return self._retry("a product", error)
            return self._refuse(f"{error}; it is dropped")
        name = f"{product.dfpc}/{product.port}"
        try:
            self._bus.call(
                keys.dpm_rpc(product.robot, "put"),
                {
                    "robot": product.robot,
                    "dfpc": product.dfpc,
                    "port": product.port,
                    "product": product.product,
                },
                payload=product.payload,
                encoding=product.encoding,
                attachment=product.attachment,
                timeout_s=_PUT_TIMEOUT_S + len(product.payload) / _SLOWEST_BYTES_S,
            )
        except CdffError as error:
            if isinstance(error, UnavailableError) or error.retriable:
                if not isinstance(error, NoAnswerError | DeadlineError | OverloadedError):
                    entry.failures += 1  # the DPM answered: others may be accepted before this one
                return self._retry(name, error)
            if type(error) is CdffError:  # an internal error of the DPM; a restarted DPM may accept it
                entry.failures += 1
                return self._retry(name, error)
            return self._refuse(f"the DPM refused {name}: {error}")
        return True

    def _retry(self, name: str, error: Exception) -> bool:
        """Log why a product stays queued; return False."""
        if self.last_error != str(error):
            logger.warning("%s waits for the DPM: %s", name, error)
        self.last_error = str(error)
        return False

    def _refuse(self, reason: str) -> bool:
        """Count and log a product that is dropped; return True."""
        self.refused += 1
        self.last_error = reason
        logger.error("%s", reason)
        return True
