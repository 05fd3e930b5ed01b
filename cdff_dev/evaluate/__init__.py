# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy against truth: ``make evaluate`` reruns every figure and writes ``docs/evaluation/*.json``.

A module of this package with a function ``evaluate(data: Path, progress: Callable[[str], None]) -> dict`` is an
evaluation; its name is that of the file written. One with ``draw(figures) -> bytes`` has its SVG beside the page of
its DFPC in ``docs/dfpcs``, one with ``table(figures) -> str`` its tables in that page, between two marks. Figures
carry trials and seeds; the frame around them says which commit, lock file, Python and machine they come from.
"""
