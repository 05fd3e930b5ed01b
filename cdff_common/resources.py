# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files that ship with the framework: profiles, missions, demonstrations and simulated scenarios.

In a checkout they are in ``deploy/``; a wheel carries them as package data.
"""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path

from cdff_common.errors import ConfigurationError
from cdff_common.terminal import first_sentence

#: Name of one file of each kind, for messages.
_SINGULAR = {"profiles": "profile", "missions": "mission", "demo": "demonstration", "simulation": "scenario"}
#: Comments about the licence and the schema.
_NO_DESCRIPTION = ("# SPDX", "# yaml-language-server")
_PACKAGE = Path(__file__).resolve().parent


def deploy_folder() -> Path:
    """Return the folder that holds ``profiles``, ``missions``, ``demo`` and ``simulation``."""
    packaged = _PACKAGE / "deploy"
    return packaged if packaged.is_dir() else _PACKAGE.parent / "deploy"


def shipped_names(kind: str) -> list[str]:
    """Return the names of the files of one kind, for example ``profiles``."""
    return sorted(path.stem for path in (deploy_folder() / kind).glob("*.yaml"))


def summary_of(kind: str, name: str) -> str:
    """Return the first sentence that describes a shipped file: of ``doc:``, else of its first comment."""
    lines = (deploy_folder() / kind / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    doc = next((line.removeprefix("doc:").strip() for line in lines if line.startswith("doc:")), None)
    if doc is not None:
        return first_sentence(doc)
    comments = takewhile(lambda line: line.startswith("#"), lines)
    texts = [line.lstrip("# ") for line in comments if not line.startswith(_NO_DESCRIPTION)]
    return first_sentence(" ".join(texts))


def resolve(kind: str, name: str | Path) -> Path:
    """Return the file that ``name`` refers to: a path, or the name of a shipped file.

    Parameters
    ----------
    kind : str
        ``profiles``, ``missions``, ``demo`` or ``simulation``.
    name : str or Path
        ``rover_traverse`` or ``path/to/file.yaml``.

    Raises
    ------
    ConfigurationError
        If there is neither such a file nor such a shipped name.
    """
    path = Path(name)
    if path.is_file():
        return path
    shipped = deploy_folder() / kind / f"{name}.yaml"
    # A path with a folder or a suffix names a file, not a shipped name.
    if path.name == str(name) and not path.suffix and shipped.is_file():
        return shipped
    shipped_text = ", ".join(shipped_names(kind)) or "none"
    raise ConfigurationError(f"{_SINGULAR[kind]} {str(name)!r}: no such file; shipped are {shipped_text}")
