# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files that survive the process of a DFPC: checkpoint of its state, and record of its activity."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path

from cdff_common.clock import monotonic_s
from cdff_common.codecs import decode_payload, encode_payload
from cdff_common.errors import CdffError, CodecError
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.output import replace_file
from cdff_common.process import data_dir_of

logger = logging.getLogger(__name__)

#: Longest period between two checkpoints while samples are stepped, seconds: the loss at a SIGKILL.
PERIOD_S = 10.0
#: Period after the first checkpoint, seconds; it doubles with each one, since early seconds matter most.
FIRST_S = 0.5


def state_file(robot: str, dfpc: str) -> Path:
    """Return the path of the checkpoint of a DFPC, below ``CDFF_DATA_DIR``."""
    return data_dir_of() / "dfpc" / robot / f"{dfpc}.state"


class StateStore:
    """Checkpoint file of one DFPC.

    The file holds the encoding and the SHA-256 of the payload, a line each, then the payload: a
    ``cdff_common.types`` object in UPER.

    Parameters
    ----------
    path : Path
    period_s : float
        Longest period between two checkpoints; the first is ``FIRST_S``.
    """

    def __init__(self, path: Path, period_s: float = PERIOD_S) -> None:
        self._path, self._period_s = path, period_s
        self._wait_s = min(FIRST_S, period_s)
        self._revision = 0
        self._saved_s: float | None = None

    def restore(self, dfpc: Dfpc) -> None:
        """Resume a freshly configured DFPC from the file, if there is one.

        Raises
        ------
        CodecError
            If the file is corrupt; it is renamed to ``….broken`` and the DFPC is reset.
        OSError
            If the file cannot be read or renamed; the DFPC is reset.
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

    def checkpoint_first(self, dfpc: Dfpc) -> None:
        """Write the first state, so that a frame of published products survives the process."""
        if self._saved_s is None:
            self.checkpoint(dfpc)

    def checkpoint(self, dfpc: Dfpc, *, now: bool = False) -> None:
        """Write a changed state if the period is over, or ``now``.

        A failed write is logged and repeated a period later; the DFPC continues.
        """
        if dfpc.state_revision == self._revision:
            return
        if not now and self._saved_s is not None and monotonic_s() - self._saved_s < self._wait_s:
            return
        state = dfpc.state()
        try:
            if state is None:
                self._path.unlink(missing_ok=True)
            else:
                payload, encoding = encode_payload(state)
                head = f"{encoding}\n{hashlib.sha256(payload).hexdigest()}\n"
                replace_file(self._path, head.encode() + payload, sync=True)
        except OSError as error:
            logger.warning("%s is not written: %s", self._path, error)
            self._saved_s, self._wait_s = monotonic_s(), self._period_s
            return
        if state is None:
            self._saved_s, self._wait_s = None, min(FIRST_S, self._period_s)
        else:
            if self._saved_s is not None:
                self._wait_s = min(2.0 * self._wait_s, self._period_s)
            self._saved_s = monotonic_s()
        self._revision = dfpc.state_revision

    def _read(self) -> object:
        head, _, digest_and_payload = self._path.read_bytes().partition(b"\n")
        digest, _, payload = digest_and_payload.partition(b"\n")
        if hashlib.sha256(payload).hexdigest().encode() != digest:
            raise CodecError(f"{self._path}: the SHA-256 does not match; the file is renamed to *.broken")
        return decode_payload(payload, head.decode("ascii", "replace"))


class ActivityRecord:
    """File with the input sources of a DFPC; it exists while the DFPC is active."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write(self, sources: Mapping[str, str]) -> None:
        """Record activity; a failed write is logged, since the orchestrator can activate the DFPC."""
        try:
            replace_file(self._path, json.dumps(dict(sources)).encode())
        except OSError as error:
            logger.warning("%s is not written: %s", self._path, error)

    def read(self) -> dict[str, str] | None:
        """Return the sources of a DFPC that was active when its process ended; None otherwise."""
        try:
            sources = json.loads(self._path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            logger.warning("%s: %s", self._path, error)
            return None
        return {str(p): str(s) for p, s in sources.items()} if isinstance(sources, dict) else None

    def remove(self) -> None:
        """Remove the record; a failure is logged, since deactivation continues."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            logger.warning("%s is not removed: %s", self._path, error)
