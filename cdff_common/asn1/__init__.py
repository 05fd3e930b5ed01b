# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ASN.1 modules: the definitions of all message types, one file per family of types."""

from __future__ import annotations

from pathlib import Path

#: Folder of the ``.asn`` files.
ASN1_DIR = Path(__file__).parent


def asn1_files() -> list[Path]:
    """Return all ``.asn`` files, sorted by name."""
    return sorted(ASN1_DIR.glob("*.asn"))
