# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fit of models of rotation to measured orientations."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.rigid_body.drifting_fit import DriftingFit, DriftingProblem
from cdff_core.rigid_body.motion_models import (
    RotationModel,
    SteadyRotation,
    Tumble,
    orientation_derivatives,
    rate_derivatives,
)
from cdff_core.rigid_body.rotation_starts import steady_start, tumble_starts

#: Largest numbers of steps of the Gauss-Newton method and of halvings of a step, and the size of a step in
#: standard deviations below which the method has converged.
_MAX_STEPS, _MAX_HALVINGS, _CONVERGED = 30, 6, 0.02
#: Largest step in units of `RotationModel.scale`.
_MAX_STEP = 0.5
#: Number of orientations of the first of the parts to which a model is fitted; each further part is twice
#: as long.
_FIRST_PART = 8
#: Number of orientations with which initial values of a tumble are compared.
_SEARCH_PART = 64
#: Number of initial values that are always compared; a wrong one can explain few orientations by chance.
_MIN_STARTS = 2
#: Angle from the axis of the middle moment within which moments are unobservable, rad, and number of times
#: at which the angle is tested.
_MIDDLE_AXIS_RAD, _CHECKED = 0.2, 200
#: Growth of the number of orientations after which orientations that the fit does not explain start a new
#: search.
_SEARCH_GROWTH = 2.0
#: Largest deviation of the mean squared residual from 1, in standard deviations, that noise explains.
_EXPLAINED = 2.0
_COLUMNS = ("t_s", "orientations", "covariances")
#: Number of orientations and sum of the rotations between them, rad, from which a tumble is considered.
_MIN_TUMBLE, _MIN_TURN_RAD = 12, 2.0
#: Selection of `drifting_fit.RATIOS` that is tried in the Gauss-Newton steps.
_COARSE_RATIOS = (0.0, 1e-4, 1e-2, 1.0)
#: Squared normalised innovation above which an orientation is an outlier: probability 1.6e-5.
_OUTLIER = 25.0
#: Degrees of freedom of the t distribution of noise, and the factor on a covariance that marks an outlier.
_FREEDOM, _OUTLIER_WEIGHT = 5.0, (5.0 + _OUTLIER) / 8.0
#: Factor on the covariance of an outlier, and largest number of rounds in which outliers are determined
#: again.
_EXCLUDED, _MAX_ROUNDS = 1e8, 5
#: Least improvement of the Bayesian information criterion that justifies the five parameters of the inertia.
_MIN_GAIN = 10.0


@dataclass(frozen=True, slots=True)
class RotationFit:
    """Model of rotation fitted to orientations.

    Attributes
    ----------
    model : RotationModel
        Epoch `epoch_s`.
    fit : DriftingFit
        The last linear fit about the model; its step is negligible.
    epoch_s, last_s : float
        Time of the parameters and of the last measurement.
    inliers : ndarray of bool (n,)
    criterion : float
        Bayesian information criterion; smaller is better.
    searched : int
        Number of orientations at the last search for initial values.
    searched_s : float
        Time of the last orientation at this search, relative to the epoch.
    is_tumble_tested : bool
        Whether the orientations of this search, or those that the fit explains, were enough to distinguish a
        tumble.
    """

    model: RotationModel
    fit: DriftingFit
    epoch_s: float
    last_s: float
    inliers: BoolArray
    criterion: float
    searched: int = 0
    searched_s: float = 0.0
    is_tumble_tested: bool = False

    @property
    def may_tumble(self) -> bool:
        """True for a steady rotation whose orientations could belong to a tumble."""
        return not isinstance(self.model, Tumble) and not self.is_tumble_tested

    @property
    def drift_rotation(self) -> FloatArray:
        """Rotation (3, 3) by which the reference frame has drifted until the last measurement."""
        return se3.exp_so3(self.fit.state)

    def predict(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return orientations, their covariances, rates and their covariances at times.

        The times are not earlier than the last measurement. Orientations are ``R_reference_body`` (n, 3, 3),
        covariances (n, 3, 3) of the rotation vector and of the rate, all in axes of the reference frame;
        rates (n, 3), rad/s.
        """
        by_angle = orientation_derivatives(self.model, t_s - self.epoch_s)
        by_rate = rate_derivatives(self.model, t_s - self.epoch_s)
        orientations = self.drift_rotation @ self.model.orientations(t_s - self.epoch_s)
        by_angle = by_angle - self.fit.state_derivatives
        walk = self.fit.intensity * np.maximum(t_s - self.last_s, 0.0)[:, None, None] * np.eye(3)
        angles = _propagate_covariance(by_angle, self.fit.covariance) + self.fit.state_covariance + walk
        rates = self.model.rates(t_s - self.epoch_s) @ self.drift_rotation.T
        return (
            np.asarray(orientations),
            angles,
            np.asarray(rates),
            _propagate_covariance(by_rate, self.fit.covariance),
        )


def fit_rotation(
    t_s: FloatArray,
    orientations: FloatArray,
    covariances: FloatArray,
    *,
    is_noise_known: bool,
    guess: RotationFit | None = None,
) -> RotationFit:
    """Return the steady rotation, or the tumble if the orientations are much more probable with it.

    Parameters
    ----------
    t_s : ndarray (n,)
        Ascending times.
    orientations, covariances : ndarray (n, 3, 3)
        ``R_reference_body``; covariance of the rotation vector in axes of the reference frame, rad².
    is_noise_known : bool
        False: the covariances are known up to a common factor.
    guess : RotationFit, optional
        Earlier fit; replaces the search for initial values if it explains the orientations.
    """
    data = _Orientations(t_s, orientations, covariances, is_noise_known)
    n = len(t_s)
    search = (0, 0.0, False) if guess is None else (guess.searched, guess.searched_s, guess.is_tumble_tested)
    # With a limited number of orientations, the search is repeated after as many new ones.
    grown = n if guess is None else search[0] + int((t_s > guess.epoch_s + search[1]).sum())
    is_due = grown >= _SEARCH_GROWTH * search[0] or (data.has_turned and not search[2])
    fits: list[RotationFit] = []
    if guess is not None:
        with suppress(InputError):  # raised if the fit reaches the axis of the middle moment
            fits.append(data.fit(_later(guess.model, data.epoch_s - guess.epoch_s), part=n))
    best = _most_probable(fits)
    if best is None or (is_due and not data.is_explained(best)):
        fits.append(data.fit(steady_start(t_s, orientations)))
        if data.has_turned and not data.is_explained(fits[-1]):
            with suppress(InputError):  # as above
                fits.append(data.fit(data.best_start(tumble_starts(t_s, orientations)), _SEARCH_PART))
        best = _most_probable([fit for fit in fits if _is_predictable(fit)])
        search = (n, float(t_s[-1]) - data.epoch_s, data.has_turned)
    elif guess is not None:
        search = (search[0], search[1] + guess.epoch_s - data.epoch_s, search[2])
    if best is None:
        raise InputError(f"{n} orientations, expected at least 1")
    searched, searched_s, is_tested = search
    return replace(
        best,
        searched=searched,
        searched_s=searched_s,
        is_tumble_tested=is_tested or (data.has_turned and data.is_explained(best)),
    )


def _most_probable(fits: Sequence[RotationFit]) -> RotationFit | None:
    """Return the best fit; a tumble only if it is much more probable than each steady rotation."""
    steady = min((f for f in fits if not isinstance(f.model, Tumble)), key=_criterion, default=None)
    tumble = min((f for f in fits if isinstance(f.model, Tumble)), key=_criterion, default=None)
    if steady is None or tumble is None:
        return steady or tumble
    return tumble if tumble.criterion < steady.criterion - _MIN_GAIN else steady


def is_at_middle_axis(fit: RotationFit) -> bool:
    """Return whether the rate stays near the axis of the middle moment.

    This rotation is unstable. A slow rotation of the reference frame would give the same orientations, so
    that the moments of inertia are unobservable.
    """
    model = fit.model
    if not isinstance(model, Tumble):
        return False
    times_s = np.linspace(0.0, fit.last_s - fit.epoch_s, _CHECKED)
    body_rates = np.einsum("nji,nj->ni", model.orientations(times_s), model.rates(times_s))
    _, axes = np.linalg.eigh(model.inertia)
    cosines = np.abs(body_rates @ axes[:, 1]) / np.linalg.norm(body_rates, axis=1)
    return bool(cosines.min() > np.cos(_MIDDLE_AXIS_RAD))


def _is_predictable(fit: RotationFit) -> bool:
    """Return whether the closed form has values near the parameters of the fit."""
    try:
        fit.predict(np.array([fit.last_s]))
    except InputError:
        return False
    return True


def _criterion(fit: RotationFit) -> float:
    return fit.criterion


@dataclass(frozen=True)
class _Orientations:
    """Orientations to which models are fitted; arguments of `fit_rotation`."""

    t_s: FloatArray
    orientations: FloatArray
    covariances: FloatArray
    is_noise_known: bool

    @property
    def epoch_s(self) -> float:
        return float(self.t_s[0])

    @property
    def has_turned(self) -> bool:
        """True if the orientations are enough, and different enough, to distinguish a tumble."""
        turns_rad = se3.rotation_angle(np.swapaxes(self.orientations[:-1], 1, 2) @ self.orientations[1:])
        return len(self.t_s) >= _MIN_TUMBLE and float(turns_rad.sum()) >= _MIN_TURN_RAD

    def is_explained(self, fit: RotationFit) -> bool:
        """Return whether the residuals are independent, and as small as the noise if it is known."""
        freedom = 3 * len(self.t_s) - fit.model.size
        is_small = fit.fit.noise_factor < 1.0 + _EXPLAINED * np.sqrt(2.0 / freedom)
        return fit.fit.intensity == 0.0 and (bool(is_small) or not self.is_noise_known)

    def best_start(self, starts: Sequence[Tumble]) -> RotationModel:
        """Return the most probable of the models after a fit to the first part of the orientations.

        Raises
        ------
        InputError
            If each of them rotates about the axis of the middle moment, where the closed form has no value.
        """
        searched = replace(self, **{name: getattr(self, name)[:_SEARCH_PART] for name in _COLUMNS})
        best: RotationFit | None = None
        for start_count, start in enumerate(starts):
            if best is not None and start_count >= _MIN_STARTS and searched.is_explained(best):
                break
            try:
                fit = searched.fit(start)
            except InputError:
                continue
            best = fit if best is None or fit.criterion < best.criterion else best
        if best is None:
            raise InputError("rotation about the axis of the middle moment: expected another tumble")
        return best.model

    def fit(self, start: RotationModel, part: int = _FIRST_PART) -> RotationFit:
        """Fit one model to successively longer parts of the orientations, at last to all without outliers."""
        model, n = start, len(self.t_s)
        while part < n:
            model, _ = self._converge(model, slice(0, part))
            part *= 2
        model, weights = self._converge(model, slice(0, n))
        weights = np.where(weights > _OUTLIER_WEIGHT, _EXCLUDED, 1.0)
        for _ in range(_MAX_ROUNDS):
            model, _ = self._converge(model, slice(0, n), weights)
            fit = self._problem(model, slice(0, n), weights).solve()
            squared = weights * np.einsum("ni,ni->n", fit.normalised, fit.normalised)
            updated = np.where(squared > _OUTLIER, _EXCLUDED, 1.0)
            if np.array_equal(updated, weights):
                break
            weights = updated
        criterion = -2.0 * fit.likelihood + model.size * np.log(3 * n)
        return RotationFit(model, fit, self.epoch_s, float(self.t_s[-1]), weights == 1.0, float(criterion))

    def _converge(
        self, model: RotationModel, part: slice, fixed_weights: FloatArray | None = None
    ) -> tuple[RotationModel, FloatArray]:
        """Return the model after Gauss-Newton steps, and the factors (n,) on the covariances.

        Without fixed factors, they are those of a Student's t distribution of the noise, which limits the
        effect of outliers.
        """
        weights = self._weights(model, part) if fixed_weights is None else fixed_weights
        for _ in range(_MAX_STEPS):
            problem = self._problem(model, part, weights)
            fit = problem.solve(_COARSE_RATIOS)
            ratio = fit.intensity / fit.noise_factor / problem.unit_intensity
            step = fit.step * min(1.0, _MAX_STEP / max(float(np.abs(fit.step / model.scale).max()), 1e-12))
            objective = self._objective(model, part, weights, ratio)
            for _ in range(_MAX_HALVINGS):
                changed_model = model.moved(step)
                if self._objective(changed_model, part, weights, ratio) <= objective:
                    break
                step = 0.5 * step
            else:
                return model, weights
            model = changed_model
            if fixed_weights is None:
                squared = weights[part] * np.einsum("ni,ni->n", fit.normalised, fit.normalised)
                weights[part] = _student_weights(squared)
            sigma = np.sqrt(np.maximum(np.diagonal(fit.covariance), 1e-300))
            if np.abs(step / sigma).max() < _CONVERGED:
                break
        return model, weights

    def _weights(self, model: RotationModel, part: slice) -> FloatArray:
        """Return the factors (n,) of the residuals of a model, 1 outside the part."""
        problem = self._problem(model, part, np.ones(len(self.t_s)), with_derivatives=False)
        inverse_covariance_residuals = np.linalg.solve(problem.covariances, problem.residuals[:, :, None])[
            :, :, 0
        ]
        weights = np.ones(len(self.t_s))
        weights[part] = _student_weights(
            np.einsum("ni,ni->n", problem.residuals, inverse_covariance_residuals)
        )
        return weights

    def _objective(self, model: RotationModel, part: slice, weights: FloatArray, ratio: float) -> float:
        """Return the negative log-likelihood of a model; infinite where the model has no orientations."""
        try:
            problem = self._problem(model, part, weights, with_derivatives=False)
        except InputError:
            return float("inf")
        moments = model.log_moments if isinstance(model, Tumble) else np.zeros((3, 3))
        return -problem.solve([ratio]).likelihood + 0.5 * float((moments**2).sum())

    def _problem(
        self, model: RotationModel, part: slice, weights: FloatArray, *, with_derivatives: bool = True
    ) -> DriftingProblem:
        """Return the linear problem about a model for a part of the orientations, with factors on their
        covariances.
        """
        t_s = self.t_s[part] - self.epoch_s
        rotation_errors = self.orientations[part] @ np.swapaxes(model.orientations(t_s), 1, 2)
        by_angle = orientation_derivatives(model, t_s) if with_derivatives else np.empty((len(t_s), 3, 0))
        prior = np.zeros((by_angle.shape[2],) * 2)
        prior[6:, 6:] = np.eye(len(prior[6:]))  # moments of inertia differ by factors below about ten
        return DriftingProblem(
            residuals=np.asarray(se3.log_so3(rotation_errors)),
            derivatives=by_angle,
            covariances=self.covariances[part] * weights[part, None, None],
            t_s=t_s,
            order=1,
            prior=prior,
            is_noise_known=self.is_noise_known,
        )


def _later(model: RotationModel, t_s: float) -> RotationModel:
    """Return the model with an epoch that is later by ``t_s``."""
    times = np.array([t_s])
    R, rate = model.orientations(times)[0], model.rates(times)[0]
    return Tumble(R, R.T @ rate, model.log_moments) if isinstance(model, Tumble) else SteadyRotation(R, rate)


def _student_weights(squared: FloatArray) -> FloatArray:
    """Return the factors on covariances for squared normalised residuals with a t distribution."""
    return np.maximum((_FREEDOM + squared) / (_FREEDOM + 3.0), 1.0)


def _propagate_covariance(derivative: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariances (n, 3, 3) of linear functions (n, 3, p) of parameters."""
    return np.asarray(derivative @ covariance @ np.swapaxes(derivative, 1, 2))
