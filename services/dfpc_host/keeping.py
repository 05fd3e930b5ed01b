# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a DFPC must not lose when its process ends: its state in a file, whole or not at all, and that it was active."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path

from cdff_common.clock import monotonic_s
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string, parse_encoding
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import CdffError, CodecError
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.process import data_dir_of

logger = logging.getLogger(__name__)

#: Least time between two savings while samples are stepped, seconds: what a SIGKILL may cost.
PERIOD_S = 10.0
#: The same after the first saving; it doubles with each: while little is known, seconds are most of it.
FIRST_S = 0.5


def state_file(robot: str, dfpc: str) -> Path:
    """Where the state of a DFPC of a robot lies, below ``CDFF_DATA_DIR``."""
    return data_dir_of() / "dfpc" / robot / f"{dfpc}.state"


class Keeper:
    """Saves and gives back the state of one DFPC.

    The file holds the encoding and the SHA-256 of the payload, a line each, then the payload: a
    ``cdff_common.types`` object in UPER.

    Parameters
    ----------
    path : Path
    period_s : float
        The longest; it begins with ``FIRST_S``.
    """

    def __init__(self, path: Path, period_s: float = PERIOD_S) -> None:
        self._path, self._period_s = path, period_s
        self._wait_s = min(FIRST_S, period_s)
        self._revision = 0
        self._saved_s: float | None = None

    def give_back(self, dfpc: Dfpc) -> None:
        """Have a freshly configured DFPC resume from the file, where there is one.

        Raises
        ------
        CodecError
            If the file is damaged; it is put aside as ``….broken`` and the DFPC begins anew.
        OSError
            If the file cannot be read or put aside; the DFPC begins anew.
        """
        if self._path.is_file():
            try:
                dfpc.resume(self._read())
            except CdffError:
                dfpc.reset()
                self._path.replace(self._path.with_suffix(".broken"))
                raise
            self._saved_s = monotonic_s()
        self._revision = dfpc.state_revision

    def keep_first(self, dfpc: Dfpc) -> None:
        """Save the first state of all: what is published in a frame that begins here must outlive the process."""
        if self._saved_s is None:
            self.keep(dfpc)

    def keep(self, dfpc: Dfpc, *, now: bool = False) -> None:
        """Save the state where it has changed and was not saved within the period, or ``now``.

        A disk that is full or cannot be written is logged, and tried again a period later: the DFPC goes on.
        """
        if dfpc.state_revision == self._revision:
            return
        if not now and self._saved_s is not None and monotonic_s() - self._saved_s < self._wait_s:
            return
        try:
            saved = self._save(dfpc.state())
        except OSError as error:
            logger.warning("%s is not kept: %s", self._path, error)
            self._saved_s, self._wait_s = monotonic_s(), self._period_s
            return
        if not saved:
            self._saved_s, self._wait_s = None, min(FIRST_S, self._period_s)
        else:
            if self._saved_s is not None:
                self._wait_s = min(2.0 * self._wait_s, self._period_s)
            self._saved_s = monotonic_s()
        self._revision = dfpc.state_revision

    def _save(self, state: object | None) -> bool:
        """Write a state, or remove the file where there is none; whether there is one."""
        if state is None:
            self._path.unlink(missing_ok=True)
            return False
        payload = encode(state, "uper")
        head = f"{encoding_string(wire_type(state), 'uper')}\n{hashlib.sha256(payload).hexdigest()}\n"
        self._write(head.encode() + payload)
        return True

    def _read(self) -> object:
        head, _, rest = self._path.read_bytes().partition(b"\n")
        digest, _, payload = rest.partition(b"\n")
        if hashlib.sha256(payload).hexdigest().encode() != digest:
            raise CodecError(f"{self._path}: its SHA-256 is not the one written with it; it is put aside")
        type_name, codec = parse_encoding(head.decode("ascii", "replace"))
        return decode(type_name, payload, codec)

    def _write(self, data: bytes) -> None:
        """Write beside the file and rename, so that a kill leaves the old or the new one."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        part = self._path.with_suffix(".part")
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(self._path)


class Activity:
    """That a DFPC is active and what feeds its ports, for the process that follows.

    Parameters
    ----------
    path : Path
        The file is there while the DFPC is active.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def keep(self, wired: Mapping[str, str]) -> None:
        """Say that it is active; a folder that cannot be written is logged: the orchestrator activates it then."""
        part = self._path.with_suffix(".active_part")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps(dict(wired)), encoding="utf-8")
            part.replace(self._path)
        except OSError as error:
            logger.warning("%s is not written: %s", self._path, error)

    def left(self) -> dict[str, str] | None:
        """What fed it when its process ended; None where it was not active, or what is left of it cannot be read."""
        try:
            wired = json.loads(self._path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            logger.warning("%s: %s", self._path, error)
            return None
        return {str(port): str(source) for port, source in wired.items()} if isinstance(wired, dict) else None

    def end(self) -> None:
        """Say that it is active no more; where the file cannot be removed it is logged: deactivation goes on."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            logger.warning("%s is not removed: %s", self._path, error)
