# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parametrisation of the poses around a pose by standard deviations of its covariance."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import symmetrised


class PoseChange:
    """Poses that differ from a pose by vectors with unit covariance.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        T_view_model.
    centre_m : ndarray, shape (3,)
        Point of the model about which the model is rotated.
    covariance : ndarray, shape (6, 6)
        [x y z rx ry rz] in the frame of the view, m2 and rad2.
    """

    def __init__(self, T: FloatArray, centre_m: FloatArray, covariance: FloatArray) -> None:
        self._T, self._centre_m = T, centre_m
        self._root = np.linalg.cholesky(symmetrised(covariance))

    def poses(self, vectors: FloatArray) -> FloatArray:
        """Return the poses T_view_model (k, 4, 4) that differ from the pose by vectors (k, 6)."""
        changes = vectors @ self._root.T
        poses = np.repeat(np.eye(4)[None], len(vectors), axis=0)
        poses[:, :3, :3] = R = se3.exp_so3(changes[:, 3:]) @ self._T[:3, :3]
        at_centre = self._T[:3, :3] @ self._centre_m + self._T[:3, 3] + changes[:, :3]
        poses[:, :3, 3] = at_centre - R @ self._centre_m
        return poses

    def covariance(self, of_vectors: FloatArray) -> FloatArray:
        """Return the covariance (6, 6) of the pose for a covariance (6, 6) of the vector."""
        return symmetrised(self._root @ of_vectors @ self._root.T)
