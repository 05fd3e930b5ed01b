# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The ASN.1 modules: source of truth of the wire, one family of types a file."""

from __future__ import annotations

from pathlib import Path

#: Folder of the ``.asn`` files.
ASN1_DIR = Path(__file__).parent


def asn1_files() -> list[Path]:
    """All ``.asn`` files, sorted by name."""
    return sorted(ASN1_DIR.glob("*.asn"))
