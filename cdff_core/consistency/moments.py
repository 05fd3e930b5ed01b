# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotation between two sets of vectors from their second moments, with unknown noise on each axis.

Vectors ``a`` and ``b`` of one motion, measured by two sensors in axes that should be parallel, satisfy
``a = R b + noise`` (Wahba 1965, doi:10.1137/1007077). The variance of the noise on each axis is unknown and
is replaced by its estimate, so that the logarithm of the likelihood is ``-n/2 sum_k log(S_k(R))``, where
``S_k`` is the sum of the squared residuals on axis k.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Levi-Civita symbol.
_EPSILON = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _EPSILON[_i, _j, _k], _EPSILON[_i, _k, _j] = 1.0, -1.0
#: Contractions of the symbol: of (k, m) to the gradient (3,), and of (k, m, p) to the information (3, 3).
_GRADIENT = -np.swapaxes(_EPSILON, 1, 2).reshape(9, 3)
_INFORMATION = np.einsum("kjm,klp->kmpjl", _EPSILON, _EPSILON).reshape(27, 9)
#: Number of Gauss-Newton steps of the search for the best rotation, and largest step, rad.
_STEPS, _LARGEST_STEP_RAD = 6, 0.5
#: Prior standard deviation of a rotation, rad; it only matters where the data contain no information.
PRIOR_RAD = 2.0


@dataclass(frozen=True, slots=True)
class Moments:
    """Sums over pairs of vectors, for each of k time offsets.

    Attributes
    ----------
    n : float
        Number of pairs, with the weights of old ones reduced.
    aa, ab, bb : ndarray, shape (k, 3, 3)
        Sums of ``a a'``, ``a b'`` and ``b b'``.
    axes : ndarray, shape (3,)
        1 for each axis of a that is measured, otherwise 0.
    floor : float
        Variance of an error of the model, added to the mean squares of the residuals.
    """

    n: float
    aa: FloatArray
    ab: FloatArray
    bb: FloatArray
    axes: FloatArray
    floor: float

    @classmethod
    def empty(cls, offsets: int, axes: tuple[int, ...], floor: float) -> Moments:
        """Return the moments of no pairs."""
        zero = np.zeros((offsets, 3, 3))
        mask = np.zeros(3)
        mask[list(axes)] = 1.0
        return cls(0.0, zero, zero, zero, mask, floor)

    def added(self, a: FloatArray, b: FloatArray, keep: float = 1.0) -> Moments:
        """Return the moments with pairs ``a``, ``b`` (k, m, 3), and the previous ones times ``keep``."""
        return replace(
            self,
            n=keep * self.n + a.shape[1],
            aa=keep * self.aa + np.einsum("kmi,kmj->kij", a, a),
            ab=keep * self.ab + np.einsum("kmi,kmj->kij", a, b),
            bb=keep * self.bb + np.einsum("kmi,kmj->kij", b, b),
        )

    def at(self, index: int) -> Moments:
        """Return the moments of one time offset."""
        return replace(self, aa=self.aa[index], ab=self.ab[index], bb=self.bb[index])

    def swapped(self) -> Moments:
        """Return the moments with the roles of a and b exchanged; only for three measured axes."""
        return replace(self, aa=self.bb, ab=np.swapaxes(self.ab, -1, -2), bb=self.aa)

    def squares(self, R: FloatArray) -> FloatArray:
        """Return the sums of the squared residuals (..., 3) at rotations (..., 3, 3), with the floor."""
        u = R @ self.bb @ np.swapaxes(R, -1, -2)
        sums = (
            np.einsum("...kk->...k", self.aa)
            - 2.0 * np.einsum("...kj,...kj->...k", R, self.ab)
            + np.einsum("...kk->...k", u)
        )
        return np.asarray(np.maximum(sums, 0.0) + max(self.n, 1e-9) * self.floor)

    def log_likelihood(self, R: FloatArray) -> FloatArray:
        """Return the logarithm of the likelihood (...) of rotations (..., 3, 3)."""
        return np.asarray(-0.5 * self.n * (np.log(self.squares(R)) @ self.axes))

    def normal_equations(self, R: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return information (..., 3, 3) and gradient (..., 3) for ``R -> Exp(d) R``, with fixed noise."""
        weights = self.n * self.axes / self.squares(R)
        Rt = np.swapaxes(R, -1, -2)
        u = R @ self.bb @ Rt
        r = self.ab @ Rt - u
        batch = R.shape[:-2]
        gradient = (weights[..., None] * r).reshape(*batch, 9) @ _GRADIENT
        weighted = weights[..., None, None] * u[..., None, :, :]
        information = (weighted.reshape(*batch, 27) @ _INFORMATION).reshape(*batch, 3, 3)
        return information, gradient


def total_log_likelihood(groups: tuple[Moments, ...], R: FloatArray) -> FloatArray:
    """Return the sum of the logarithms of the likelihoods of groups, with the prior of the rotation."""
    angle = np.arccos(np.clip((np.einsum("...ii->...", R) - 1.0) / 2.0, -1.0, 1.0))
    prior = -0.5 * (angle / PRIOR_RAD) ** 2
    return np.asarray(sum((group.log_likelihood(R) for group in groups), prior))


def fitted_rotation(groups: tuple[Moments, ...]) -> FloatArray:
    """Return the most likely rotation (k, 3, 3) for each time offset of groups with common offsets.

    The search starts from the identity and from the most likely of the 24 rotations of a cube.
    """
    k = groups[0].aa.shape[0]
    cube = cube_rotations()
    starts = np.broadcast_to(cube[:, None], (len(cube), k, 3, 3))
    likelihood = total_log_likelihood(groups, starts)
    best = cube[np.argmax(likelihood, axis=0)]
    refined_rotations = _refine_rotations(groups, np.stack([np.broadcast_to(np.eye(3), (k, 3, 3)), best]))
    most_likely = np.argmax(total_log_likelihood(groups, refined_rotations), axis=0)
    return np.asarray(refined_rotations[most_likely, np.arange(k)])


def rotation_information(groups: tuple[Moments, ...], R: FloatArray) -> FloatArray:
    """Return the information (..., 3, 3) about small rotations of the a axes at ``R``."""
    return np.asarray(sum(group.normal_equations(R)[0] for group in groups))


def _refine_rotations(groups: tuple[Moments, ...], R: FloatArray) -> FloatArray:
    """Return rotations after Gauss-Newton steps."""
    for _ in range(_STEPS):
        information = np.eye(3) / PRIOR_RAD**2
        gradient = se3.log_so3(R) / PRIOR_RAD**2
        for group in groups:
            H, g = group.normal_equations(R)
            information, gradient = information + H, gradient + g
        step = -np.linalg.solve(information, gradient[..., None])[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step = step * np.minimum(1.0, _LARGEST_STEP_RAD / np.maximum(length, 1e-12))
        R = se3.exp_so3(step) @ R
    return R


@cache
def cube_rotations() -> NDArray[np.float64]:
    """Return the 24 rotations (24, 3, 3) that map the axes to each other, the identity first."""
    rotations = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0.0:
                rotations.append(R)
    return np.array(sorted(rotations, key=lambda R: -float(np.trace(R))))
