# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CFDP transactions: the transfer of a file to the ground segment, and of a file from it."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

from cfdppy.handler.dest import DestHandler
from cfdppy.handler.source import SourceHandler, TransactionStep
from cfdppy.request import PutRequest
from spacepackets.cfdp.defs import ConditionCode, DeliveryCode, TransmissionMode
from spacepackets.cfdp.pdu import AckPdu, DirectiveType, TransactionStatus
from spacepackets.util import ByteFieldU16

from cdff_common.clock import monotonic_s
from services.gateway_ccsds.cfdp_entity import (
    MAX_RECEIVED_BYTES,
    CheckTimers,
    MemoryFiles,
    SentFile,
    User,
    local_entity,
    remote_entities,
)
from services.gateway_ccsds.settings import CfdpSettings

#: Largest number of received PDUs of a transaction that wait to be processed.
_MAX_WAITING = 256


class _Number:
    """Provider of the number of one transaction."""

    max_bit_width = 32

    def __init__(self, number: int) -> None:
        self._number = number

    def get_and_increment(self) -> int:
        return self._number


class OutgoingTransfer:
    """Transfer of a file to the ground segment with CFDP class 2, one transaction.

    Parameters
    ----------
    settings : CfdpSettings
    path : Path
    number : int
        Transaction number.
    timer_s : float
        Interval after which an EOF PDU without an answer is sent again, seconds.

    Attributes
    ----------
    changed_s : float
        Monotonic time of the last PDU from the ground segment, or of the last file data.
    """

    def __init__(self, settings: CfdpSettings, path: Path, number: int, timer_s: float) -> None:
        self.path, self.number = path, number
        self._user = User(SentFile(path))
        table = remote_entities(settings, timer_s)
        self._handler = SourceHandler(
            local_entity(settings), self._user, table, CheckTimers(), _Number(number)
        )
        self._handler.put_request(
            PutRequest(
                destination_id=ByteFieldU16(settings.remote),
                source_file=Path(path.name),
                dest_file=Path(path.name),
                trans_mode=TransmissionMode.ACKNOWLEDGED,
                closure_requested=False,
            )
        )
        self._received: deque[Any] = deque(maxlen=_MAX_WAITING)
        self.changed_s = monotonic_s()

    def receive(self, pdu: Any) -> None:
        """Add a PDU of the ground segment to the queue of the transaction."""
        self.changed_s = monotonic_s()
        self._received.append(pdu)

    def next_pdu(self) -> bytes | None:
        """Return the next PDU to send; None if there is none at present."""
        if not self._handler.packets_ready and not self.is_finished:
            self._step(self._received.popleft() if self._received else None)
        if not self._handler.packets_ready:
            return None
        return bytes(self._handler.get_next_packet().pdu.pack())

    def _step(self, pdu: Any) -> None:
        is_finished = pdu is not None and pdu.directive_type == DirectiveType.FINISHED_PDU
        if is_finished and self._handler.step == TransactionStep.WAITING_FOR_EOF_ACK:
            # The ACK of EOF was lost; in this state the library ignores Finished PDUs.
            ack = AckPdu(
                pdu.pdu_header.pdu_conf,
                DirectiveType.EOF_PDU,
                ConditionCode.NO_ERROR,
                TransactionStatus.ACTIVE,
            )
            self._handler.state_machine(ack)
        self._handler.state_machine(pdu)

    @property
    def has_data(self) -> bool:
        """True while file data are to be sent for the first time."""
        return bool(self._handler.step.value < TransactionStep.WAITING_FOR_EOF_ACK.value)

    @property
    def is_finished(self) -> bool:
        """True if the ground segment has reported its result."""
        return self._user.result is not None

    @property
    def is_delivered(self) -> bool:
        """True if the ground segment has received the complete file."""
        result = self._user.result
        if result is None or result.condition_code != ConditionCode.NO_ERROR:
            return False
        return bool(result.delivery_code == DeliveryCode.DATA_COMPLETE)

    @property
    def failure(self) -> str:
        """Reason of the ground segment why the file was not delivered."""
        result = self._user.result
        return "no answer" if result is None else f"{result.condition_code.name}, {result.file_status.name}"


class IncomingFile:
    """Transaction that receives a file of the ground segment; only one at a time.

    Parameters
    ----------
    settings : CfdpSettings
    timer_s : float
        Interval after which a NAK or Finished PDU without an answer is sent again, seconds.
    """

    def __init__(self, settings: CfdpSettings, timer_s: float) -> None:
        self._files = MemoryFiles()
        self._user = User(self._files)
        table = remote_entities(settings, timer_s)
        self._handler = DestHandler(local_entity(settings), self._user, table, CheckTimers())
        self._received: deque[Any] = deque(maxlen=_MAX_WAITING)
        self._id: Any = None
        self.changed_s = monotonic_s()

    def accepts(self, pdu: Any) -> bool:
        """Add a PDU; return False if it belongs to another transaction, or to a file that is too large."""
        number = (pdu.source_entity_id.value, pdu.transaction_seq_num.value)
        if self._id not in (None, number):
            return False
        if getattr(pdu, "file_size", None) is not None and pdu.file_size > MAX_RECEIVED_BYTES:
            return False
        self._id, self.changed_s = number, monotonic_s()
        self._received.append(pdu)
        return True

    def next_pdu(self) -> bytes | None:
        """Return the next PDU to send; None if there is none at present."""
        if not self._handler.packets_ready:
            self._handler.state_machine(self._received.popleft() if self._received else None)
        if not self._handler.packets_ready:
            return None
        return bytes(self._handler.get_next_packet().pdu.pack())

    def take(self) -> tuple[str, bytes] | None:
        """Return name and content of the complete file, once; None before that and afterwards."""
        result = self._user.result
        if result is None or result.condition_code != ConditionCode.NO_ERROR:
            return None
        self._user.result = None
        return self._user.file_name, bytes(self._files.content)

    @property
    def is_idle(self) -> bool:
        """True if the transaction has ended and all received PDUs are processed."""
        return not self._received and self._handler.transaction_id is None
