# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The run time of a DFPC without any middleware: used by the host process and by replay."""

from cdff_core.runtime.runner import Counters, Runner

__all__ = ["Counters", "Runner"]
