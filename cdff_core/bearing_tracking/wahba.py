# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wahba's problem: the rotation that aligns directions known in two frames.

References
----------
.. [1] Markley, F. L. (1988). Attitude determination using vector observations and the singular value
   decomposition.
   Journal of the Astronautical Sciences 36(3).
.. [2] Shuster, M. D., Oh, S. D. (1981). Three-axis attitude determination from vector observations.
   Journal of
   Guidance and Control 4(1), eq. 111. doi:10.2514/3.19717
"""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray


def rotation(directions: FloatArray, references: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the rotation ``R`` (3, 3) with ``references = R directions`` in weighted mean square [1]_."""
    B = (references * weights[:, None]).T @ directions
    U, _, V = np.linalg.svd(B)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(V)]) @ V)


def information(references: FloatArray, sigmas_rad: FloatArray) -> FloatArray:
    """Return the inverse covariance (3, 3) of the rotation vector in the frame of the references [2]_."""
    w = 1.0 / sigmas_rad**2
    return np.asarray(np.eye(3) * w.sum() - (references * w[:, None]).T @ references)
