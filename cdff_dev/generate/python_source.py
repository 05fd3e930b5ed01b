# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Python source from templates, formatted by ruff."""

from __future__ import annotations

import subprocess
import textwrap
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from ruff.__main__ import find_ruff_bin  # type: ignore[import-untyped]

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.array_ports import ARRAY_TYPE
from cdff_common.interfaces.description import Port, snake_case

_LINE_LENGTH = 110
#: Annotations of the types of operations that are not message types.
OPERATION_TYPES = {"void": "None", "float": "float", "int": "int", "string": "str", "bool": "bool"}


def render(template: str, **values: Any) -> str:
    """Return the text of one of ``templates/*.j2``."""
    return _environment().get_template(template).render(**values)


def formatted(source: str, path: Path) -> str:
    """Return ``source`` formatted by ruff for ``path``, with sorted imports.

    Raises
    ------
    ConfigurationError
        If the source is not valid Python, because the description contains text that is not possible in an
        identifier or docstring.
    """
    ruff = find_ruff_bin()
    config = Path(__file__).resolve().parents[2] / "pyproject.toml"
    for arguments in (["check", "--select", "I,F401", "--fix-only", "--quiet"], ["format", "--quiet"]):
        completed = subprocess.run(
            [ruff, *arguments, "--config", str(config), "--stdin-filename", str(path), "-"],
            input=source,
            capture_output=True,
            text=True,
            check=False,
        )
        if completed.returncode:
            raise ConfigurationError(
                f"{path}: the generated text is not valid Python: {completed.stderr.strip()}"
            )
        source = completed.stdout
    return source


def annotation(port: Port) -> str:
    """Return the annotation of a port: ``NDArray[np.float64]``, ``float`` or the class name."""
    match = ARRAY_TYPE.match(port.type)
    if match is None:
        return class_name(port.type_name) if port.is_message else port.type
    dtype = match["dtype"]
    return f"NDArray[np.{'bool_' if dtype == 'bool' else dtype}]"


def shape(port: Port) -> str:
    """Return the type of a port for a docstring; arrays with their shape."""
    match = ARRAY_TYPE.match(port.type)
    return f"ndarray of {match['dtype']}, shape ({match['shape']})" if match else annotation(port)


def class_name(type_name: str) -> str:
    """Return the Python class name of an ASN.1 type: without dashes, each part capitalised."""
    return "".join(part[:1].upper() + part[1:] for part in type_name.split("-"))


def sentence(text: str) -> str:
    """Return ``text`` as one line with a capital at the start and a full stop at the end."""
    line = " ".join(text.split()).replace("\\", "\\\\").replace('"""', "'''")
    if not line:
        return ""
    # A path, a key or an identifier at the start is not capitalised.
    first_word = line.split()[0]
    initial = line[0] if any(c in first_word for c in "/_*`=") else line[0].upper()
    return initial + line[1:] + ("" if line.endswith((".", "?", "!")) else ".")


def docstring(text: str, indent: int) -> str:
    """Return ``text`` as a docstring; its lines, except the first, are indented by ``indent`` spaces."""
    margin = " " * indent
    lines = textwrap.wrap(sentence(text), width=_LINE_LENGTH - indent - 10)
    return (
        f'"""{lines[0]}"""' if len(lines) == 1 else f"\n{margin}".join([f'"""{lines[0]}', *lines[1:], '"""'])
    )


def _operation_type(name: str) -> str:
    return OPERATION_TYPES.get(name, class_name(name))


@cache
def _environment() -> Environment:
    """Return the environment of the templates with the filters that they use."""
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
