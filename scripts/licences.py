# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""List the licences of the packages that ship; exit code 1 if one is under the GPL or has no licence."""

from __future__ import annotations

import re
import sys
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Lock files of what runs in containers and on robots; `all` and `evaluate` also have tools of developers.
ROLES = ("campaign", "client", "core", "dpm", "gateways", "otel", "scale", "simulate", "view")
_GPL = re.compile(r"\bGPL|GNU General Public", re.IGNORECASE)


def shipped_packages() -> list[str]:
    """Return the names of the packages in the lock files of the roles."""
    texts = [(ROOT / "requirements" / f"{role}.txt").read_text(encoding="utf-8") for role in ROLES]
    return sorted(
        {name for text in texts for name in re.findall(r"^([A-Za-z0-9._-]+)==", text, re.MULTILINE)}
    )


def licence_of(package: str) -> str | None:
    """Return the licence in the metadata of a package, empty without one; None if it is not installed."""
    try:
        fields = metadata.metadata(package)
    except metadata.PackageNotFoundError:
        return None
    classifiers = [c for c in fields.get_all("Classifier") or () if c.startswith("License ::")]
    named = ", ".join(c.rpartition(" :: ")[2] for c in classifiers)
    return fields.get("License-Expression") or named or (fields.get("License") or "").split("\n")[0]


def is_allowed(licence: str) -> bool:
    """Return whether a package with this licence may ship: any but the GPL; the LGPL permits linking."""
    return bool(licence) and not _GPL.search(licence)


def main() -> int:
    """Print a line for each package."""
    refused = []
    for package in shipped_packages():
        licence = licence_of(package)
        print(f"{package:32} {'not installed' if licence is None else licence or 'no licence stated'}")
        if licence is not None and not is_allowed(licence):
            refused.append(package)
    if refused:
        print(f"may not ship: {', '.join(refused)}", file=sys.stderr)
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
