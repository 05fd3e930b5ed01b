# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of a DFPC without middleware, for the host process and for replay."""

from cdff_core.runtime.runner import Counters, Runner

__all__ = ["Counters", "Runner"]
