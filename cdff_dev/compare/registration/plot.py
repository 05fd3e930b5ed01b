# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Figure of the errors of poses between clouds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.plots import new_figure
from cdff_dev.compare.registration.rates import pose_errors
from cdff_dev.compare.registration.read import Pair

#: Lower end of the logarithmic axes of errors, metres and degrees; smaller errors are drawn there.
_LEAST = 1e-6


def draw(
    estimate: Mapping[str, Pair], truth: Mapping[str, Pair], gates: Sequence[tuple[float, float]]
) -> Any:
    """Return a ``matplotlib.figure.Figure``: both errors of each pair, and the fraction of pairs by error.

    The arguments are those of ``compare``. Raises InputError if no pair has both poses.
    """
    true_poses = {name: pair.T for name, pair in truth.items() if pair.T is not None}
    estimated_poses = {name: estimate[name].T for name in true_poses if name in estimate}
    errors = np.array(
        [
            pose_errors(T.matrix, true_poses[name].matrix)
            for name, T in estimated_poses.items()
            if T is not None
        ]
    )
    if not len(errors):
        raise InputError("no pair has an estimated and a true pose: there is nothing to draw")
    drawn_errors = np.maximum(errors, _LEAST)
    figure = new_figure(10.4, 4.4)
    figure.suptitle(f"{len(errors)} of {len(true_poses)} pairs with a true pose were answered", fontsize=10)
    pairs, fractions = figure.subplots(1, 2)
    pairs.loglog(drawn_errors[:, 0], drawn_errors[:, 1], "o", ms=4, color="C0", alpha=0.7)
    pairs.set(xlabel="position error, m", ylabel="rotation error, degrees")
    pairs.grid(alpha=0.3)
    counts = np.arange(1, len(errors) + 1) / len(true_poses)
    for column, (colour, unit) in enumerate((("C0", "m"), ("C1", "degrees"))):
        fractions.step(
            np.sort(drawn_errors[:, column]), counts, where="post", color=colour, label=f"error, {unit}"
        )
    fractions.set(
        xscale="log", xlabel="error", ylabel="fraction of the pairs with a true pose", ylim=(0, 1.02)
    )
    fractions.grid(alpha=0.3)
    for number, (metres, degrees) in enumerate(gates):
        style = {"color": "gray", "lw": 1.0, "ls": ("--", ":", "-.")[number % 3]}
        label = f"{metres:g} m, {degrees:g}°"
        pairs.plot([_LEAST, metres, metres], [degrees, degrees, _LEAST], label=label, **style)
    low = 0.5 * drawn_errors.min(axis=0)
    high = 2.0 * np.maximum(
        drawn_errors.max(axis=0), np.max(np.array(gates).reshape(-1, 2), axis=0, initial=_LEAST)
    )
    pairs.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    pairs.legend(fontsize=8)
    fractions.legend(fontsize=8)
    return figure
