# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff check``."""

from __future__ import annotations

from typing import Any


def register(nouns: Any) -> None:
    """Add the parser of ``cdff check``."""
