# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluations of accuracy relative to ground truth; ``make evaluate`` runs all of them.

A module of this package with a function ``evaluate(data: Path, progress: Callable[[str], None]) -> dict`` is
an evaluation. The dictionary is written to ``docs/evaluation/NAME.json``, with commit, hash of the lock file,
Python version and machine. ``draw(figures) -> bytes`` returns the diagram ``docs/evaluation/NAME.svg``.
``table(figures) -> str`` returns the tables. They replace the text between the comments ``<!-- written by …
-->`` and ``<!-- until here -->`` in ``docs/evaluation/NAME.md``, or in the page that the module names in
``PAGE``. The argument ``figures`` of both functions is the dictionary that ``evaluate`` returned.
``OPTIONS`` are the options of the command line that ``evaluate`` also takes, with their defaults.
All evaluations use one thread.
"""

from cdff_common.process import cap_threads

# As in the services, and for the other programs: the CPU time of threads that wait for each other is no work.
cap_threads(1)
