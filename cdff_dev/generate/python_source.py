# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Python text from templates, sorted and formatted as ruff does it for the rest of the tree."""

from __future__ import annotations

import subprocess
import textwrap
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from ruff.__main__ import find_ruff_bin

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import ARRAY_TYPE, Port, snake_case

_LINE_LENGTH = 120
_OPERATION_TYPES = {"void": "None", "float": "float", "int": "int", "string": "str", "bool": "bool"}


def render(template: str, **values: Any) -> str:
    """Render one of ``templates/*.j2``."""
    return _environment().get_template(template).render(**values)


def formatted(source: str, path: Path) -> str:
    """``source`` with its imports sorted and its layout as ruff makes it for ``path``.

    Raises
    ------
    ConfigurationError
        If the source is no Python: a description put something into it that no identifier or docstring can hold.
    """
    ruff = find_ruff_bin()
    config = Path(__file__).resolve().parents[2] / "pyproject.toml"
    for arguments in (["check", "--select", "I,F401", "--fix-only", "--quiet"], ["format", "--quiet"]):
        done = subprocess.run(
            [ruff, *arguments, "--config", str(config), "--stdin-filename", str(path), "-"],
            input=source,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise ConfigurationError(f"{path}: the generated text is no Python: {done.stderr.strip()}")
        source = done.stdout
    return source


def is_array(port: Port) -> bool:
    """Whether a port carries a bare array instead of a type of ``cdff_common.types``."""
    return ARRAY_TYPE.match(port.type) is not None


def annotation(port: Port) -> str:
    """Python annotation of a port: ``NDArray[np.float64]`` or the class's name."""
    match = ARRAY_TYPE.match(port.type)
    if match is None:
        return class_name(port.type_name)
    dtype = match["dtype"]
    return f"NDArray[np.{'bool_' if dtype == 'bool' else dtype}]"


def shape(port: Port) -> str:
    """Docstring type of a port: array ports say their shape."""
    match = ARRAY_TYPE.match(port.type)
    return class_name(port.type_name) if match is None else f"ndarray of {match['dtype']}, shape ({match['shape']})"


def class_name(type_name: str) -> str:
    """Python class of an ASN.1 type: its name without dashes, each part beginning with a capital."""
    return "".join(part[:1].upper() + part[1:] for part in type_name.split("-"))


def sentence(text: str) -> str:
    """``text`` as one line that begins with a capital and ends with a full stop."""
    line = " ".join(text.split()).replace("\\", "\\\\").replace('"""', "'''")
    if not line:
        return ""
    # A path, a key or an identifier in front keeps its spelling.
    first = line.split()[0]
    begin = line[0] if any(c in first for c in "/_*`=") else line[0].upper()
    return begin + line[1:] + ("" if line.endswith((".", "?", "!")) else ".")


def docstring(text: str, indent: int) -> str:
    """``text`` as a docstring that is indented by ``indent`` spaces, its quotes included, its first line bare."""
    margin = " " * indent
    lines = textwrap.wrap(sentence(text), width=_LINE_LENGTH - indent - 6)
    return f'"""{lines[0]}"""' if len(lines) == 1 else f"\n{margin}".join([f'"""{lines[0]}', *lines[1:], '"""'])


def _operation_type(name: str) -> str:
    return _OPERATION_TYPES.get(name, class_name(name))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("cdff_dev.generate"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters.update(
        annotation=annotation,
        shape=shape,
        sentence=sentence,
        docstring=docstring,
        snake_case=snake_case,
        operation_type=_operation_type,
    )
    return environment
