# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What every service process does; see ``cdff_common.process``."""

from cdff_common.process import cap_threads, run_service, stop_event

__all__ = ["cap_threads", "run_service", "stop_event"]
