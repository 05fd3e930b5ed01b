# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of recorded samples: writing, and reading in a defined order."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cdff_dev.logs.formats import open_log
    from cdff_dev.logs.formats.infuse.reader import LogReader
    from cdff_dev.logs.formats.infuse.writer import LogWriter
    from cdff_dev.logs.source import LogSample, LogSource, StreamInfo

__all__ = ["LogReader", "LogSample", "LogSource", "LogWriter", "StreamInfo", "open_log"]

#: Module of each public name. Modules are imported on use: the command line imports this package at every
#: start.
_MODULES = {
    "LogReader": "formats.infuse.reader",
    "LogSample": "source",
    "LogSource": "source",
    "LogWriter": "formats.infuse.writer",
    "StreamInfo": "source",
    "open_log": "formats",
}


def __getattr__(name: str) -> Any:
    """Import the module of a public name on its first use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
