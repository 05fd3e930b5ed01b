# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""End of a rover's program whose middleware has threads of its own."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable


def run_and_exit(main: Callable[[], None]) -> None:
    """Run a program and end its process at once: the middleware may call it during the end of Python."""
    exit_status = 1
    try:
        main()
        exit_status = 0
    except Exception:
        traceback.print_exc()
        raise
    finally:
        os._exit(exit_status)
