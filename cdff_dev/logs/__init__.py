# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs: write and read recorded samples, one sample after the other in a fixed order."""

from cdff_dev.logs.open import open_log
from cdff_dev.logs.reader import LogReader
from cdff_dev.logs.source import LogSample, LogSource, StreamInfo
from cdff_dev.logs.writer import LogWriter

__all__ = ["LogReader", "LogSample", "LogSource", "LogWriter", "StreamInfo", "open_log"]
