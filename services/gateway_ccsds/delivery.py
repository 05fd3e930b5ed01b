# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transfer of the files of the spool by CFDP class 2, and reception of command files.

One thread processes all transactions. The data of a file are sent when all data of the previous file have
been sent. After a restart the file that was being sent, and files that the ground segment has not confirmed,
are sent again from their start. Out of contact nothing is sent and the timers stop: the transactions continue
in the next contact window.
"""

from __future__ import annotations

import logging
import queue
import secrets
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from spacepackets.cfdp.defs import ConditionCode, Direction
from spacepackets.cfdp.pdu import AckPdu, DirectiveType, TransactionStatus
from spacepackets.cfdp.pdu.helper import PduFactory

from cdff_common.clock import monotonic_s
from cdff_common.errors import StorageError
from cdff_common.loops import Loop
from cdff_common.output import replace_file
from services.gateway_ccsds.datagrams import DatagramPort
from services.gateway_ccsds.pacing import Pacing
from services.gateway_ccsds.settings import CfdpSettings
from services.gateway_ccsds.spool import Spool
from services.gateway_ccsds.transfers import IncomingFile, OutgoingTransfer

logger = logging.getLogger(__name__)

#: Largest number of transactions: files that are being sent, or that the ground segment has not confirmed.
_MAX_UNCONFIRMED = 8
#: Pause before a file that was not delivered is sent again, seconds.
_RETRY_S = 5.0
#: Silence of the ground segment in contact after which a transaction is repeated, seconds.
_SILENCE_S = 60.0
_TIMER_S = 3.0
_STEP_S = 0.005
_IDLE_STEP_S = 0.05
_BUSY_LIMIT_S = 30.0
_MAX_WAITING = 4096
#: Number of transaction numbers that each start of the gateway reserves for itself.
_RESERVED = 1 << 20
_NUMBERS = 1 << 31


class Delivery:
    """A CFDP entity that sends the files of a spool, one after the other.

    Parameters
    ----------
    settings : CfdpSettings
    spool : Spool
    port : DatagramPort
    state : Path
        File of the transaction numbers.
    on_file : callable
        Called with name and content of each received file.
    loop : Loop
        Health of the thread.
    delay_s : float
        One-way delay, seconds.

    Attributes
    ----------
    in_contact : bool
        True during a contact; the gateway sets it.
    counters : Counter
        ``delivered`` and ``repeated`` files, ``delivered_bytes``, ``received`` files, ``ignored`` PDUs.
    """

    def __init__(
        self,
        settings: CfdpSettings,
        spool: Spool,
        port: DatagramPort,
        state: Path,
        on_file: Callable[[str, bytes], object],
        loop: Loop,
        delay_s: float = 0.0,
    ) -> None:
        self._settings, self._spool, self._port, self._on_file = settings, spool, port, on_file
        self._timer_s = _TIMER_S + 2.0 * delay_s
        self._pacing = Pacing(settings.rate_bit_s, settings.segment_bytes)
        self._number = _reserve(state)
        self._transfers: list[OutgoingTransfer] = []
        self._incoming: IncomingFile | None = None
        self._received: queue.Queue[bytes] = queue.Queue(_MAX_WAITING)
        self._pauses: dict[Path, float] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=loop.run, args=(self._wait, self._step), name="cfdp")
        self._thread.daemon = True
        self.in_contact = False
        self.counters: Counter[str] = Counter()

    def start(self) -> None:
        """Start the thread, and receive PDUs."""
        self._port.start(self._receive)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread; files that are not confirmed remain in the spool."""
        self._stop.set()
        self._thread.join(_BUSY_LIMIT_S)
        self._port.close()

    @property
    def unconfirmed(self) -> int:
        """Number of files that are being sent, or that the ground segment has not confirmed."""
        return len(self._transfers)

    def _receive(self, data: bytes) -> None:
        try:
            self._received.put_nowait(data)
        except queue.Full:
            self.counters["ignored"] += 1

    def _wait(self) -> bool | None:
        """Wait until the next step; return None at the end."""
        is_busy = self.in_contact and (self._transfers or self._incoming)
        return None if self._stop.wait(_STEP_S if is_busy else _IDLE_STEP_S) else True

    def _step(self, _: object) -> None:
        while not self._received.empty():
            self._dispatch(self._received.get_nowait())
        if not self.in_contact:
            now_s = monotonic_s()
            for transfer in self._transfers:
                transfer.changed_s = now_s
            return
        self._begin()
        self._send()
        self._end()

    def _dispatch(self, data: bytes) -> None:
        """Pass a received PDU to its transaction."""
        try:
            pdu: Any = PduFactory.from_raw(data)
            if pdu.direction == Direction.TOWARDS_SENDER:
                self._pass_to_sender(pdu)
                return
            if self._incoming is None:
                self._incoming = IncomingFile(self._settings, self._timer_s)
            if not self._incoming.accepts(pdu):
                self.counters["ignored"] += 1
        except Exception as error:  # noqa: BLE001  # the library does not list its errors of malformed PDUs
            self.counters["ignored"] += 1
            logger.debug("PDU ignored: %s: %s", type(error).__name__, error)

    def _pass_to_sender(self, pdu: Any) -> None:
        number = pdu.transaction_seq_num.value
        for transfer in self._transfers:
            if transfer.number == number:
                transfer.receive(pdu)
                return
        if pdu.directive_type == DirectiveType.FINISHED_PDU:  # its acknowledgement was lost
            conf, done = pdu.pdu_header.pdu_conf, TransactionStatus.TERMINATED
            self._port.send(
                bytes(AckPdu(conf, DirectiveType.FINISHED_PDU, ConditionCode.NO_ERROR, done).pack())
            )

    def _begin(self) -> None:
        """Begin the transfer of the next file when all data of the previous one are sent."""
        if len(self._transfers) >= _MAX_UNCONFIRMED or any(t.has_data for t in self._transfers):
            return
        busy, now_s = {transfer.path for transfer in self._transfers}, monotonic_s()
        for path in self._spool.files():
            if path in busy or self._pauses.get(path, 0.0) > now_s or not self._spool.is_ready(path):
                continue
            self._transfers.append(OutgoingTransfer(self._settings, path, self._number, self._timer_s))
            self._number = (self._number + 1) % _NUMBERS
            return

    def _send(self) -> None:
        """Send the PDUs of all transactions at the rate of the link, those of earlier ones first."""
        for transaction in (self._incoming, *self._transfers):
            while transaction is not None and self._pacing.is_open:
                try:
                    pdu = transaction.next_pdu()
                except Exception as error:  # noqa: BLE001  # as above
                    self.counters["ignored"] += 1
                    logger.debug("PDU ignored: %s: %s", type(error).__name__, error)
                    break
                if pdu is None:
                    break
                self._pacing.take(len(pdu))
                self._port.send(pdu)

    def _end(self) -> None:
        """Remove delivered files from the spool; repeat those that are refused or not answered."""
        now_s = monotonic_s()
        for transfer in tuple(self._transfers):
            if transfer.has_data:
                transfer.changed_s = now_s
            if not transfer.is_finished and now_s - transfer.changed_s < _SILENCE_S:
                continue
            self._transfers.remove(transfer)
            if transfer.is_delivered:
                self.counters["delivered"] += 1
                self.counters["delivered_bytes"] += transfer.path.stat().st_size
                self._pauses.pop(transfer.path, None)
                self._spool.remove(transfer.path)
                continue
            self.counters["repeated"] += 1
            self._pauses[transfer.path] = now_s + _RETRY_S
            logger.warning("%s is not delivered (%s); it is sent again", transfer.path.name, transfer.failure)
        incoming = self._incoming
        if incoming is None:
            return
        if (received := incoming.take()) is not None:
            self.counters["received"] += 1
            self._on_file(*received)
        if incoming.is_idle or now_s - incoming.changed_s > _SILENCE_S:
            self._incoming = None


def _reserve(path: Path) -> int:
    """Return the first transaction number to use, and store on disk the first number for the next start.

    The ground segment ignores a transaction whose number was used before, so each start uses new numbers. If
    the file does not exist, the first number is random.
    """
    try:
        first = int(path.read_text(encoding="ascii")) if path.exists() else secrets.randbelow(_NUMBERS)
        replace_file(path, str((first + _RESERVED) % _NUMBERS).encode(), sync=True)
    except (OSError, ValueError) as error:
        raise StorageError(f"{path}: {error}; expected the next transaction number") from error
    return first
