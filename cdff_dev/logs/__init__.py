# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs: write and read recorded samples, one sample after the other in a fixed order."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cdff_dev.logs.log_formats import open_log
    from cdff_dev.logs.reader import LogReader
    from cdff_dev.logs.source import LogSample, LogSource, StreamInfo
    from cdff_dev.logs.writer import LogWriter

__all__ = ["LogReader", "LogSample", "LogSource", "LogWriter", "StreamInfo", "open_log"]

#: Where each name lies; imported on use, since the command line imports this package to list its commands.
_MODULES = {
    "LogReader": "reader",
    "LogSample": "source",
    "LogSource": "source",
    "LogWriter": "writer",
    "StreamInfo": "source",
    "open_log": "log_formats",
}


def __getattr__(name: str) -> Any:
    """Import one of the public names when it is first asked for."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
