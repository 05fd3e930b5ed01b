# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figures and their files. The figures belong to no window, so that no display is needed."""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path
from typing import Any

from cdff_common.errors import InputError
from cdff_common.extras import import_extra
from cdff_common.output import check_file, write_file

_DPI = 120
_NOTEBOOK_DPI = 72
_FORMATS = ("png", "svg")


def new_figure(width_in: float = 9.0, height_in: float = 7.0) -> Any:
    """Return an empty ``matplotlib.figure.Figure``, which notebooks show as a picture.

    Raises CdffError if matplotlib is not installed.
    """
    return _figure_class()(figsize=(width_in, height_in), layout="constrained")


@cache
def _figure_class() -> Any:
    """Return a class of figures that notebooks show without a backend of matplotlib."""
    base: Any = import_extra("matplotlib.figure").Figure

    class NotebookFigure(base):  # type: ignore[misc]
        """Figure that notebooks show without a backend of matplotlib."""

        def _repr_png_(self) -> bytes:
            out = io.BytesIO()
            self.savefig(out, format="png", dpi=_NOTEBOOK_DPI)
            return out.getvalue()

    return NotebookFigure


def figure_bytes(figure: Any, form: str = "png") -> bytes:
    """Return a figure as ``png`` or ``svg``; in svg, texts are text, and equal figures give equal bytes."""
    out = io.BytesIO()
    if form == "png":
        figure.savefig(out, format="png", dpi=_DPI)
        return out.getvalue()
    settings = {"svg.fonttype": "none", "svg.hashsalt": "cdff"}
    with import_extra("matplotlib").rc_context(settings):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()[out.getvalue().index(b"<svg") :]


def check_plot_file(path: Path) -> str:
    """Return the format of a plot file, ``png`` or ``svg``.

    Raises InputError for another suffix, StorageError if the file cannot be written, and CdffError if
    matplotlib is not installed.
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in _FORMATS:
        raise InputError(f"plot {path}: the suffix {path.suffix!r} is no picture, expected .png or .svg")
    check_file(path)
    import_extra("matplotlib")
    return form


def write_figure(path: Path, figure: Any) -> None:
    """Write a figure in the format of the suffix; raises as ``check_plot_file``."""
    write_file(path, figure_bytes(figure, check_plot_file(path)))
