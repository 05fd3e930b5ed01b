# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Configuration of the library cfdp-py: entities, timers, faults, and access to files.

The ground segment can neither read, change nor remove files of this machine: the library reads only the file
that the gateway sends, and keeps received files, whose size is limited, in memory.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from cfdppy.filestore import NativeFilestore
from cfdppy.mib import (
    CheckTimerProvider,
    DefaultFaultHandlerBase,
    IndicationConfig,
    LocalEntityConfig,
    RemoteEntityConfig,
    RemoteEntityConfigTable,
)
from cfdppy.user import CfdpUserBase
from spacepackets.cfdp.defs import ChecksumType, TransmissionMode
from spacepackets.countdown import Countdown
from spacepackets.util import ByteFieldU16

from services.gateway_ccsds.settings import CfdpSettings

logger = logging.getLogger(__name__)

#: Largest received file, bytes: the ground segment sends commands only.
MAX_RECEIVED_BYTES = 65536
#: Bytes of a PDU in addition to its file data: header with ids of 2 and a number of 4 bytes, and offset.
_OVERHEAD_BYTES = 4 + 2 + 4 + 2 + 4
#: Expirations of a timer before a fault; unlimited, because the gateway limits the duration of a transaction.
_UNLIMITED = 1 << 30


class Faults(DefaultFaultHandlerBase):  # type: ignore[misc]  # the library has no types
    """Handler that logs the faults of transactions."""

    def notice_of_cancellation_cb(self, transaction_id: Any, cond: Any, progress: int) -> None:
        """Log the end of a transaction."""
        logger.warning("CFDP transaction %s ends: %s after %d bytes", transaction_id, cond, progress)

    notice_of_suspension_cb = abandoned_cb = notice_of_cancellation_cb

    def ignore_cb(self, transaction_id: Any, cond: Any, progress: int) -> None:
        """Log a fault that has no effect."""
        logger.debug("CFDP transaction %s: %s after %d bytes", transaction_id, cond, progress)


class CheckTimers(CheckTimerProvider):  # type: ignore[misc]
    """Timers of unacknowledged transactions."""

    def provide_check_timer(self, local_entity_id: Any, remote_entity_id: Any, entity_type: Any) -> Any:
        """Return a timer."""
        return Countdown.from_seconds(5.0)


class User(CfdpUserBase):  # type: ignore[misc]
    """Result of one transaction.

    Attributes
    ----------
    result : FinishedParams or None
        Condition, delivery code and file status, when the transaction has ended.
    """

    def __init__(self, store: Any) -> None:
        super().__init__(store)
        self.result: Any = None
        self.file_name = ""

    def transaction_finished_indication(self, params: Any) -> None:
        """Keep the result."""
        self.result = params.finished_params

    def metadata_recv_indication(self, params: Any) -> None:
        """Keep the name of a file that is received."""
        self.file_name = str(params.dest_file_name or "")

    def _ignore(self, *_: object) -> None:
        pass

    transaction_indication = eof_sent_indication = file_segment_recv_indication = _ignore
    report_indication = suspended_indication = resumed_indication = fault_indication = _ignore
    abandoned_indication = eof_recv_indication = _ignore


class SentFile(NativeFilestore):  # type: ignore[misc]
    """The one file that a transaction sends; its name in the PDUs has no folder.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def read_data(self, file: Path, offset: int | None, read_len: int | None = None) -> bytes:
        """Read a segment."""
        return bytes(super().read_data(self._path, offset, read_len))

    def file_exists(self, path: Path) -> bool:
        """Return whether the file exists."""
        return self._path.is_file()

    def file_size(self, file: Path) -> int:
        """Return the size, bytes."""
        return self._path.stat().st_size

    def calculate_checksum(
        self, checksum_type: Any, file_path: Path, size_to_verify: int, segment_len: int = 4096
    ) -> bytes:
        """Return the checksum of the sent file."""
        return bytes(super().calculate_checksum(checksum_type, self._path, size_to_verify, segment_len))


class MemoryFiles(NativeFilestore):  # type: ignore[misc]
    """One received file in memory.

    Attributes
    ----------
    content : bytearray
    """

    def __init__(self) -> None:
        self.content = bytearray()

    def write_data(self, file: Path, data: bytes, offset: int | None) -> None:
        """Write a segment; raises PermissionError above the limit."""
        start = offset or 0
        if start + len(data) > MAX_RECEIVED_BYTES:
            raise PermissionError(f"a received file exceeds {MAX_RECEIVED_BYTES} bytes")
        if len(self.content) < start:
            self.content.extend(bytes(start - len(self.content)))
        self.content[start : start + len(data)] = data

    def file_exists(self, path: Path) -> bool:
        """Return True: a received file replaces the previous one."""
        return True

    def is_directory(self, path: Path) -> bool:
        """Return False."""
        return False

    def truncate_file(self, file: Path) -> None:
        """Remove the content."""
        self.content.clear()

    def file_size(self, file: Path) -> int:
        """Return the size, bytes."""
        return len(self.content)

    def calculate_checksum(
        self, checksum_type: Any, file_path: Path, size_to_verify: int, segment_len: int = 4096
    ) -> bytes:
        """Return the modular checksum (CCSDS 727.0-B-5, 4.2.2)."""
        if checksum_type not in (ChecksumType.MODULAR, ChecksumType.NULL_CHECKSUM):
            raise PermissionError(f"checksum {checksum_type}: expected MODULAR")
        if checksum_type == ChecksumType.NULL_CHECKSUM:
            return bytes(4)
        padded = bytes(self.content) + bytes(-len(self.content) % 4)
        words = (int.from_bytes(padded[i : i + 4], "big") for i in range(0, len(padded), 4))
        return (sum(words) & 0xFFFFFFFF).to_bytes(4, "big")

    def _refuse(self, *_: object) -> Any:
        raise PermissionError("the ground segment cannot change files here")

    read_data = create_file = delete_file = rename_file = replace_file = _refuse
    create_directory = remove_directory = list_directory = _refuse


def local_entity(settings: CfdpSettings) -> Any:
    """Return the configuration of the entity of the robot."""
    indications = IndicationConfig(False, False, False, True, False, False)
    return LocalEntityConfig(ByteFieldU16(settings.entity), indications, Faults())


def remote_entities(settings: CfdpSettings, timer_s: float) -> Any:
    """Return the table with the entity of the ground segment.

    ``timer_s`` is the interval after which an EOF, Finished or NAK PDU is repeated, seconds.
    """
    remote = RemoteEntityConfig(
        entity_id=ByteFieldU16(settings.remote),
        max_file_segment_len=settings.segment_bytes,
        max_packet_len=settings.segment_bytes + _OVERHEAD_BYTES,
        closure_requested=False,
        crc_on_transmission=False,
        default_transmission_mode=TransmissionMode.ACKNOWLEDGED,
        crc_type=ChecksumType.MODULAR,
        positive_ack_timer_interval_seconds=timer_s,
        positive_ack_timer_expiration_limit=_UNLIMITED,
        nak_timer_interval_seconds=timer_s,
        nak_timer_expiration_limit=_UNLIMITED,
    )
    return RemoteEntityConfigTable([remote])
