# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A log that a command line opens: the elapsed time is shown while its index is read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from cdff_common.progress import elapsed
from cdff_dev.logs.formats import open_log

if TYPE_CHECKING:
    from cdff_dev.logs.source import LogSource


@contextmanager
def opened(path: str | Path, calibration: Path | None = None) -> Iterator[LogSource]:
    """Open a log as ``open_log`` for the duration of the context."""
    with elapsed("opening the log"):
        log = open_log(path, calibration)
    try:
        yield log
    finally:
        log.close()
