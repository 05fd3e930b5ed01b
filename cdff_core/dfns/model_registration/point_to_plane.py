# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-plane registration with a prediction: nearest surface points, then rendered ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import symmetrised
from cdff_common.geometry.robust import median_sigma
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.model_registration.interface import Inputs, Interface, Outputs
from cdff_core.object_models.nearest_grid import NearestGrid
from cdff_core.object_models.pose_equations import nearest_distances, nearest_equations, rendered_equations
from cdff_core.object_models.rendering import Window
from cdff_core.object_models.views import view_rotation

#: Number of points and least number of steps of the registration with the nearest surface points, and its
#: last scale, diameters of the model.
_NEAREST_POINTS, _LEAST_STEPS, _LAST_SCALE = 400, 2, 0.05
#: Capture range, and standard deviation of an unknown pose, diameters of the model.
_CAPTURE, _UNKNOWN = 0.25, 0.2
#: Margin of the window around the body.
_MARGIN = 1.15
#: Least number of points that agree with the model: one for each unknown of a pose.
_MIN_AGREEING = 6
#: Ratio of the initial to the last scale above which the first limit of the rendered iterations is doubled.
_WIDE = 1.5
#: Squared step, in standard deviations of the result, at which the registration has converged.
_CONVERGED = 0.02
#: Weight of the residual of a ray that misses the model, its distance from the outline, relative to a range
#: residual.
_MISS = 4.0
#: Range differences up to this number of standard deviations agree.
_SIGMAS = 3.0


class PointToPlaneConfig(DfnConfig):
    """Parameters of PointToPlane."""

    steps_per_octave: float = Field(
        3.0, ge=0, le=50, description="Steps with the nearest points for each halving of the capture range"
    )
    rendered_iterations: int = Field(4, ge=1, le=20, description="Steps with rendered ranges")
    pixels: int = Field(128, ge=16, le=1024, description="Pixels of a side of the rendering")
    limit_sigmas: float = Field(
        4.0, ge=1, le=20, description="Range difference from which a ray has no weight, standard deviations"
    )
    model_sigma: float = Field(
        0.002, ge=0, le=0.1, description="Standard deviation of the surface, relative to the diameter"
    )
    model_bias: float = Field(
        0.0003, ge=0, le=0.1, description="Error of the surface that all rays share, relative to the diameter"
    )
    min_information: float = Field(
        0.006,
        ge=0,
        le=1,
        description="Information per ray below which a direction is not constrained by the points",
    )
    inflation: float = Field(
        1.5,
        ge=1,
        le=100,
        description="Factor of the covariance of the points: errors of neighbours correlate",
    )
    outline: bool = Field(
        default=True,
        description="Rays that miss the model pull its outline, and count against the agreement; False if "
        "the body touches others, as on a table",
    )


class PointToPlane(Interface[PointToPlaneConfig]):
    """Point-to-plane distances (Chen and Medioni 1992, doi:10.1016/0262-8856(92)90066-C) along the rays.

    Each Gauss-Newton step is one of an iterated Kalman filter: the prediction contributes its information.
    Directions that the points do not constrain are removed from their equations (Zhang et al. 2016,
    doi:10.1109/ICRA.2016.7487211): they keep the prediction.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the registered pose; raises InputError or RefusedError."""
        cfg = self.config
        fit = _Fit(inputs, cfg)
        d = inputs.diameter_m
        last_m = max(_LAST_SCALE * d, _SIGMAS * fit.sigma_m)
        # Points of other bodies are further from the surface than most points of a body that is near.
        capture_m = min(inputs.capture_m or _CAPTURE * d, _SIGMAS * fit.median_distance())
        first_m = max(capture_m, last_m)
        steps = _LEAST_STEPS + int(np.ceil(cfg.steps_per_octave * np.log2(first_m / last_m)))
        for scale_m in np.geomspace(first_m, last_m, steps):
            fit.step(*fit.nearest(float(scale_m)))
        # The first limit is wide if the start was: the nearest points leave an error along the rays.
        limit_m = cfg.limit_sigmas * fit.sigma_m
        widest = 2.0 if first_m > _WIDE * last_m else 1.0
        for widening in np.linspace(widest, 1.0, cfg.rendered_iterations):
            A, b, weight, residuals = fit.rendered(float(widening) * limit_m)
            step_length = fit.step(A, b, weight, constrained_only=True)
            if widening == 1.0 and step_length < _CONVERGED:
                break
        agrees = np.abs(residuals) < _SIGMAS * fit.sigma_m
        in_front = np.count_nonzero(residuals < -limit_m)
        met = np.count_nonzero(np.isfinite(residuals))
        compared = len(residuals) if cfg.outline else met - in_front
        if np.count_nonzero(agrees) < _MIN_AGREEING:
            raise RefusedError(
                f"{np.count_nonzero(agrees)} of {len(residuals)} points agree with the model", ["no_overlap"]
            )
        agreement = float(np.count_nonzero(agrees) / compared)
        return fit.outputs(residuals[np.abs(residuals) < limit_m], agreement, float(in_front / met))


@dataclass(slots=True)
class _Weak:
    """Projection (6, 6) on the constrained directions, its square root, and the degenerate directions (j,
    6).
    """

    projection: FloatArray
    root: FloatArray
    directions: FloatArray


class _Fit:
    """State of one registration."""

    def __init__(self, inputs: Inputs, config: PointToPlaneConfig) -> None:
        self._config, d = config, inputs.diameter_m
        n = len(inputs.scan)
        if n < _MIN_AGREEING:
            raise RefusedError(f"{n} points, expected at least {_MIN_AGREEING}", ["no_overlap"])
        self._times_s = np.zeros(n) if inputs.times_s is None else np.array(inputs.times_s, np.float64)
        if len(self._times_s) != n:
            raise InputError(f"times_s: {len(self._times_s)} of {n} points, expected one for each point")
        self._points_m = np.array(inputs.scan, np.float64)
        self.T = np.array(inputs.pose, np.float64)
        self.sigma_m = float(np.hypot(inputs.sigma_m, config.model_sigma * d))
        self._surface = (
            np.ascontiguousarray(inputs.points, np.float64),
            np.ascontiguousarray(inputs.normals, np.float64),
            NearestGrid(inputs.grid_index, inputs.grid_low, inputs.grid_cell_m),
        )
        self._vertices = np.ascontiguousarray(inputs.drawn_vertices, np.float64)
        self._triangles: IntArray = np.ascontiguousarray(inputs.drawn_triangles, np.int64)
        self._centre_m, self._diameter_m = inputs.centre_m, d
        self._set_prior(inputs)
        self._set_window()
        self._weak = _Weak(np.eye(6), np.eye(6), np.zeros((0, 6)))
        self._H = np.zeros_like(self._P)
        self._information = np.zeros((6, 6))

    def _set_prior(self, inputs: Inputs) -> None:
        """Store state Jacobian, prior covariance and prior error; raises InputError if their sizes differ."""
        J = inputs.state_jacobian
        self._J = np.eye(12, 6) if J is None else np.array(J, np.float64)
        k = self._J.shape[1]
        self._has_prior = inputs.prior_covariance is not None
        unknown = np.full(k, (_UNKNOWN * self._diameter_m) ** 2)
        unknown[3:6] = _UNKNOWN**2
        P = inputs.prior_covariance
        self._P = np.diag(unknown) if P is None else np.array(P, np.float64)
        error = inputs.prior_error
        self._prior_error = np.zeros(k) if error is None else np.array(error, np.float64)
        if self._P.shape != (k, k) or self._prior_error.shape != (k,):
            raise InputError(
                f"prior_covariance {self._P.shape}, prior_error {self._prior_error.shape}: expected {k} "
                "errors as in state_jacobian"
            )
        self._correction = np.zeros(k)

    def _set_window(self) -> None:
        """Set the window of the rendering around the body at the start."""
        centre = self.T[:3, :3] @ self._centre_m + self.T[:3, 3]
        distance_m, radius_m = float(np.linalg.norm(centre)), 0.5 * _MARGIN * self._diameter_m
        if distance_m <= radius_m:
            raise RefusedError("the sensor is inside the body", ["sensor_inside"])
        self._R_view = view_rotation(-centre)
        self._to_sensor = np.kron(np.eye(4), self._R_view.T)
        n = self._config.pixels
        tangent = radius_m / np.sqrt(distance_m**2 - radius_m**2)
        focal, middle = 0.5 * (n - 1) / tangent, 0.5 * (n - 1)
        self._window = Window(focal, focal, middle, middle, n, n)

    def median_distance(self) -> float:
        """Return the median distance of the points from the surface at the start, metres."""
        points_m = np.ascontiguousarray(self._points_m[:: -(-len(self._points_m) // _NEAREST_POINTS)])
        surface_m, _, grid = self._surface
        return float(np.median(nearest_distances(self.T, points_m, surface_m, grid)))

    def nearest(self, scale_m: float) -> tuple[FloatArray, FloatArray, float]:
        """Return the normal equations (12, 12), (12,) with the nearest surface points, and their weight."""
        step = -(-len(self._points_m) // _NEAREST_POINTS)
        A, b = np.empty((12, 12)), np.empty(12)
        points_m, times_s = self._points_m[::step], self._times_s[::step]
        weight = nearest_equations(
            self.T, np.ascontiguousarray(points_m), times_s, *self._surface, scale_m, A, b
        )
        return step * A, step * b, step * weight

    def rendered(self, limit_m: float) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        """Return the normal equations with rendered ranges, their weight, and the range differences (n,)."""
        R = self._R_view
        surface_m, _, grid = self._surface
        A, b = np.empty((12, 12)), np.empty(12)
        residuals = np.empty(len(self._points_m))
        T_view_model = se3.transform(R, np.zeros(3)) @ self.T
        weight = rendered_equations(
            T_view_model,
            self._points_m @ R.T,
            self._times_s,
            self._vertices,
            self._triangles,
            self._window,
            surface_m,
            grid,
            limit_m,
            _MISS if self._config.outline else 0.0,
            A,
            b,
            residuals,
        )
        A = self._to_sensor @ A @ self._to_sensor.T
        return A, self._to_sensor @ b, weight, residuals

    def step(self, A: FloatArray, b: FloatArray, weight: float, *, constrained_only: bool = False) -> float:
        """Correct pose, state and points by one Gauss-Newton step; return its squared normalised size.

        With ``constrained_only``, directions that the points do not constrain keep the prediction.
        """
        # An error that all rays share does not decrease with their number.
        bias_m = self._config.model_bias * self._diameter_m
        variance = self._config.inflation * (self.sigma_m**2 + weight * bias_m**2)
        if constrained_only:
            self._weak = self._weak_directions(A[:6, :6], weight)
            root, whole = (np.kron(np.eye(2), Q) for Q in (self._weak.root, self._weak.projection))
            A, b = root @ A @ root.T, whole @ b
        A, b = A / variance, b / variance
        J, k = self._J, len(self._correction)
        self._information, self._H = A[:6, :6], J.T @ A @ J
        remaining = self._prior_error - self._correction if self._has_prior else np.zeros(k)
        # (P^-1 + H)^-1 (P^-1 e + J^T b), without the inverse of P.
        delta = np.linalg.solve(np.eye(k) + self._P @ self._H, self._P @ (J.T @ b) + remaining)
        self._correction = self._correction + delta
        moved = J @ delta
        origin = self.T[:3, 3]
        if self._times_s.any():
            displaced = moved[6:9] + (self._points_m - origin) @ se3.skew(moved[9:]).T
            self._points_m = self._points_m - self._times_s[:, None] * displaced
        R = se3.normalise_rotation(se3.exp_so3(moved[3:6]) @ self.T[:3, :3])
        self.T = se3.transform(R, origin + moved[:3])
        return float(moved[:6] @ A[:6, :6] @ moved[:6])

    def _weak_directions(self, A: FloatArray, weight: float) -> _Weak:
        """Return the directions in which the information (6, 6) per ray is small."""
        # Errors of the pose from displacements of the centre and rotations about it, of half the diameter.
        half_m = 0.5 * self._diameter_m
        to_origin = np.eye(6)
        to_origin[:3, 3:] = se3.skew(self.T[:3, :3] @ self._centre_m)
        to_origin[:, 3:] /= half_m
        values, vectors = np.linalg.eigh(symmetrised(to_origin.T @ A @ to_origin))
        min_information = self._config.min_information * max(weight, 1e-9)
        # The information of a direction near the limit comes from wrong pairs: it decreases to 0.
        shares = np.clip(values / max(min_information, 1e-300) - 1.0, 0.0, 1.0)
        from_origin = np.linalg.inv(to_origin)
        projection, root = (
            (to_origin @ (vectors * factor) @ vectors.T @ from_origin).T
            for factor in (shares, np.sqrt(shares))
        )
        return _Weak(projection, root, vectors[:, shares <= 0.0].T)

    def outputs(self, residuals: FloatArray, agreement: float, in_front: float) -> Outputs:
        """Return the result."""
        k = len(self._correction)
        covariance = np.linalg.solve(np.eye(k) + self._P @ self._H, self._P)
        return Outputs(
            pose=self.T,
            correction=self._correction,
            covariance=symmetrised(covariance),
            information=symmetrised(self._information),
            weak_directions=self._weak.directions,
            agreement=agreement,
            in_front=in_front,
            sigma_m=median_sigma(residuals),
        )
