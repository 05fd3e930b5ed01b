# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of directions of the space of poses, for reports of degenerate ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_AXES = "xyz"
#: Cosine from which a direction is named after an axis.
_ALONG_AXIS = 0.85


def direction_names(directions: Float) -> list[str]:
    """Return names of directions that span the same space as the rows ``(k, 6)``, along axes where possible.

    Eigenvectors of nearly equal eigenvalues are an arbitrary basis of their space: on flat ground the names
    are x, y and the rotation about z, even if each row is a mixture of the three.
    """
    projector = directions.T @ directions
    names = []
    for kind, block in (("translation", projector[:3, :3]), ("rotation", projector[3:, 3:])):
        ratios, vectors = np.linalg.eigh(block)
        axes = [axis for axis in range(3) if block[axis, axis] >= _ALONG_AXIS**2]
        if len(axes) == np.count_nonzero(ratios > 0.5):
            names += [f"{kind}_{_AXES[axis]}" for axis in axes]
        else:
            names += [f"{kind}{_components(vector)}" for vector in vectors.T[ratios > 0.5]]
    return names or [direction_name(direction) for direction in directions]


def direction_name(direction: Float) -> str:
    """Return ``translation_x``, ``rotation_z``, … or, if the direction is along no axis, its components."""
    translation, rotation = direction[:3], direction[3:]
    is_translation = np.linalg.norm(translation) >= np.linalg.norm(rotation)
    kind, vector = ("translation", translation) if is_translation else ("rotation", rotation)
    unit = vector / max(float(np.linalg.norm(vector)), 1e-12)
    axis = int(np.argmax(np.abs(unit)))
    along_axis = abs(unit[axis]) >= _ALONG_AXIS
    return f"{kind}_{_AXES[axis]}" if along_axis else f"{kind}{_components(unit)}"


def _components(unit: Float) -> str:
    x, y, z = unit * np.sign(unit[np.argmax(np.abs(unit))])
    return f"({x:.2f},{y:.2f},{z:.2f})"
