# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Competing rigid motions among the tracked points, and selection of the motion of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.perspective_n_point_solving.interface import PerspectiveNPointSolvingInputs
from cdff_core.stereo_odometry.motion_prior import GATE, MotionBounds

#: Maximum number of motions, and number of samples of three points for each motion after the first: if 36 %
#: of the remaining points move together, one of 150 samples has no outlier with a probability of 99.9 %.
_MAX_HYPOTHESES, _SAMPLES = 3, 150
#: Minimum number of points, and minimum fraction of the tracked points, of a competing motion.
_MIN_POINTS, _MIN_FRACTION = 15, 0.08
#: Wheels and gyro support a motion if its difference is below this ratio of their bounds, three standard
#: deviations.
_SUPPORTED_RATIO = 0.6
#: Number of columns and rows of cells in which the coverage of the image is counted.
_CELLS = (20, 10)
#: A point contradicts a motion if its error exceeds the threshold of the outlier rejection by this factor.
_CONTRADICTION = 1.5
#: Ratio of the plausibility of a competing motion to that of the selected one above which the selection is
#: uncertain: each covers 23 % to 77 % of the image. An object over more than half precedes the scene.
MAX_AMBIGUITY = 0.3
#: The extent of points is the rectangle beyond which this fraction of the pixels lies on each side.
_EXTENT_QUANTILE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A rigid motion of some of the tracked points.

    Attributes
    ----------
    pose : array, shape (4, 4)
        ``T_current_keyframe``.
    inliers : array of bool, shape (n,)
        Tracked points that agree with the motion.
    coverage : float
        Fraction of the cells of the image with an inlier that contradicts all other motions.
    extent : float
        Area of the rectangle around these inliers, as a fraction of the image.
    is_distinct : bool
        True if most of its inliers contradict all other motions; otherwise it is a part of another motion.
    """

    pose: FloatArray
    inliers: BoolArray
    coverage: float
    extent: float
    is_distinct: bool


@dataclass(frozen=True, slots=True, eq=False)
class SelectedMotion:
    """The motion of the scene, and its competitors.

    Attributes
    ----------
    scene : Hypothesis
        The selected motion.
    others : tuple of Hypothesis
        Competing motions, in order of decreasing plausibility.
    ambiguity : float
        Largest plausibility of a competing motion divided by that of the selected one, at most 1: its extent
        times the likelihood given wheels and gyro.
    prior_ratio : float
        Difference from the motion by wheels and gyro divided by the largest plausible difference; 0 without
        those sensors.
    """

    scene: Hypothesis
    others: tuple[Hypothesis, ...]
    ambiguity: float
    prior_ratio: float

    @property
    def is_ambiguous(self) -> bool:
        """True if a competing motion could be the motion of the scene."""
        return self.ambiguity > MAX_AMBIGUITY

    def selection_covariance(self) -> FloatArray:
        """Return the covariance (6, 6) of ``T_keyframe_current`` due to an uncertain selection.

        It is the second moment of the competing motion about the selected one, weighted by the probability
        of the competing motion, which follows from the ratio of the plausibilities; zero if it is certain.
        """
        if not self.is_ambiguous:
            return np.zeros((6, 6))
        probability = self.ambiguity / (1.0 + self.ambiguity)
        T_scene, T_other = (se3.inverse(h.pose) for h in (self.scene, self.others[0]))
        difference = pose_error(T_other, T_scene)
        return np.asarray(probability * np.outer(difference, difference))

    @property
    def other_inliers(self) -> BoolArray:
        """Tracked points (n,) that agree with a competing motion and not with the selected one."""
        inliers_of_others = [other.inliers for other in self.others]
        return (
            np.any(inliers_of_others, axis=0) & ~self.scene.inliers
            if inliers_of_others
            else np.zeros_like(self.scene.inliers)
        )


class MotionHypotheses:
    """Selection of a motion by sequential RANSAC [1]_.

    Each motion is estimated from the points that are not inliers of an earlier one.

    The motion with the largest number of inliers need not be that of the scene: a textured object can have
    more points than a smooth plain. Since the scene surrounds an object, the cells of the image that contain
    inliers are counted instead; points that agree with several motions, such as distant points, do not count.
    This coverage is weighted by the likelihood of the motion given wheels and gyro, if available.

    An object that hides most of the scene has the largest coverage. The scene is then visible around it, or
    in the rest of the image: a competing motion of large extent makes the selection ambiguous.

    References
    ----------
    .. [1] P. Torr, Geometric Motion Segmentation and Model Selection, Phil. Trans. R. Soc. A 356, 1998,
       doi:10.1098/rsta.1998.0224
    """

    def __init__(self, first: Dfn, following: Dfn) -> None:  # type: ignore[type-arg]  # any configuration
        self._first, self._following = first, following
        self._following.configure(
            first.config.model_copy(update={"max_iterations": min(_SAMPLES, first.config.max_iterations)})
        )

    def select(
        self,
        inputs: PerspectiveNPointSolvingInputs,
        shape: tuple[int, int],
        bounds: MotionBounds | None,
        *,
        is_continued: bool,
        competing: Sequence[FloatArray] = (),
    ) -> SelectedMotion:
        """Return the motion of the scene; raises RefusedError if no motion has enough points.

        Parameters
        ----------
        inputs : PerspectiveNPointSolvingInputs
            Points in the frame of the keyframe, metres, their pixels in the image, and the predicted pose.
        shape : tuple of int
            Rows and columns of the image.
        bounds : MotionBounds, optional
            Motion since the keyframe by wheels or gyro, with its standard deviations.
        is_continued : bool
            True if the predicted pose continues a known velocity; among motions of similar score, the one
            nearest to the predicted pose is then selected.
        competing : sequence of array, shape (4, 4)
            ``T_current_keyframe`` of motions that competed at the last view, predicted to this one.
        """
        hypotheses = self._find(inputs, shape, bounds, competing)
        ratios = [_ratio(bounds, hypothesis.pose) for hypothesis in hypotheses]
        likelihoods = _likelihoods(ratios)
        scores = likelihoods * [max(hypothesis.coverage, 1e-9) for hypothesis in hypotheses]
        best = int(np.argmax(scores))
        plausibility = _relative_plausibility(hypotheses, likelihoods, best)
        similar = np.flatnonzero(plausibility > MAX_AMBIGUITY)
        if is_continued and len(similar) > 1:
            best = min(similar.tolist(), key=lambda i: _distance_m(hypotheses[i].pose, inputs))
            plausibility = _relative_plausibility(hypotheses, likelihoods, best)
        others = [i for i in np.argsort(-plausibility, kind="stable").tolist() if i != best]
        return SelectedMotion(
            scene=hypotheses[best],
            others=tuple(hypotheses[i] for i in others),
            ambiguity=float(plausibility[others].max(initial=0.0)),
            prior_ratio=ratios[best],
        )

    def _find(
        self,
        inputs: PerspectiveNPointSolvingInputs,
        shape: tuple[int, int],
        bounds: MotionBounds | None,
        competing: Sequence[FloatArray],
    ) -> list[Hypothesis]:
        """Return the first motion and the motions that compete with it.

        The first motion that wheels and gyro support needs fewer points, and so does a motion that continues
        one of the last view.
        """
        first = self._first.process(inputs)
        poses, remaining = [first.camera], np.flatnonzero(~first.inliers)
        errors_px = [_errors_px(first.camera, inputs)]
        threshold_px = self._first.config.threshold_px
        min_points = max(_MIN_POINTS, int(np.ceil(_MIN_FRACTION * len(inputs.points))))
        is_supported = bounds is None or _ratio(bounds, first.camera) < _SUPPORTED_RATIO
        while len(poses) < _MAX_HYPOTHESES and len(remaining) >= _MIN_POINTS:
            try:
                out = self._following.process(_subset(inputs, remaining))
            except RefusedError:
                break
            remaining = remaining[~out.inliers]
            errors = _errors_px(out.camera, inputs)
            contradicts_others = np.min(errors_px, axis=0) > _CONTRADICTION * threshold_px
            supports = not is_supported and _ratio(bounds, out.camera) < _SUPPORTED_RATIO
            only_here = (errors < threshold_px) & contradicts_others
            continues = _is_nearer(competing, errors_px, only_here, inputs)
            required = _MIN_POINTS if supports or continues else min_points
            if np.sum(only_here) < required:
                break
            is_supported |= supports
            poses.append(out.camera)
            errors_px.append(errors)
        inliers = np.array([errors < threshold_px for errors in errors_px])
        inliers[0] = first.inliers
        contradicts = np.array(errors_px) > _CONTRADICTION * threshold_px
        hypotheses = []
        for i, pose in enumerate(poses):
            only_here = inliers[i] & np.delete(contradicts, i, axis=0).all(axis=0)
            pixels = inputs.projections[only_here]
            hypotheses.append(
                Hypothesis(
                    pose,
                    inliers[i],
                    coverage=len(cells_of(pixels, shape)) / (_CELLS[0] * _CELLS[1]),
                    extent=extent_of(pixels, shape),
                    is_distinct=only_here.sum() > 0.5 * inliers[i].sum(),
                )
            )
        return hypotheses


def _is_nearer(
    competing: Sequence[FloatArray],
    found_px: Sequence[FloatArray],
    points: BoolArray,
    inputs: PerspectiveNPointSolvingInputs,
) -> bool:
    """Return whether most of some points are nearer to a predicted motion than to all motions found."""
    if not points.any():
        return False
    nearest_px = np.min(found_px, axis=0)
    return any(np.median((_errors_px(pose, inputs) - nearest_px)[points]) < 0.0 for pose in competing)


def _distance_m(pose: FloatArray, inputs: PerspectiveNPointSolvingInputs) -> float:
    """Return the median distance, metres, between the points at a pose (4, 4) and at the predicted pose."""
    if inputs.guess is None:
        return 0.0
    points_by_pose, points_by_guess = (se3.transform_points(T, inputs.points) for T in (pose, inputs.guess))
    return float(np.median(np.linalg.norm(points_by_pose - points_by_guess, axis=1)))


def _likelihoods(ratios: list[float]) -> FloatArray:
    """Return the likelihoods (k,) of motions given wheels and gyro.

    They are equal if all motions contradict those sensors, for example because wheels spin.
    """
    sigmas = GATE * np.array(ratios)
    return np.ones(len(ratios)) if sigmas.min() > GATE else np.asarray(np.exp(-0.5 * sigmas**2))


def _relative_plausibility(
    hypotheses: list[Hypothesis], likelihoods: FloatArray, selected: int
) -> FloatArray:
    """Return the ratio (k,) of the plausibility of motions to that of the selected motion, at most 1.

    Errors of points can split one motion into two with mostly the same points: those do not compete.
    """
    extents = np.array([max(hypothesis.extent, 1e-9) for hypothesis in hypotheses])
    by_extent = np.minimum(extents / extents[selected], 1.0)
    by_extent *= [i == selected or hypothesis.is_distinct for i, hypothesis in enumerate(hypotheses)]
    return np.asarray(np.minimum(by_extent * likelihoods / max(likelihoods[selected], 1e-300), 1.0))


def _ratio(bounds: MotionBounds | None, pose: FloatArray) -> float:
    """Return ``prior_ratio`` of a pose ``T_current_keyframe`` (4, 4)."""
    return 0.0 if bounds is None else bounds.ratio(se3.inverse(pose))


def _subset(inputs: PerspectiveNPointSolvingInputs, indices: np.ndarray) -> PerspectiveNPointSolvingInputs:
    """Return the inputs with the points of the indices (k,) only."""
    return PerspectiveNPointSolvingInputs(
        points=inputs.points[indices],
        projections=inputs.projections[indices],
        camera_matrix=inputs.camera_matrix,
        guess=inputs.guess,
    )


def _errors_px(pose: FloatArray, inputs: PerspectiveNPointSolvingInputs) -> FloatArray:
    """Return the reprojection errors (n,), pixels; infinite for points behind the camera."""
    points = se3.transform_points(pose, inputs.points)
    projected = points / np.maximum(points[:, 2:], 1e-6) @ np.asarray(inputs.camera_matrix).T
    errors_px = np.hypot(*(projected[:, :2] - inputs.projections).T)
    return np.where(points[:, 2] > 1e-6, errors_px, np.inf)


def cells_of(pixels: FloatArray, shape: tuple[int, ...]) -> IntArray:
    """Return the numbers of the cells of an image that contain one of the pixels (n, 2)."""
    rows, columns = shape
    cells = (pixels * [_CELLS[0] / columns, _CELLS[1] / rows]).astype(np.int64)
    cells = np.clip(cells, 0, np.array(_CELLS) - 1)
    return np.unique(cells[:, 1] * _CELLS[0] + cells[:, 0])


def extent_of(pixels: FloatArray, shape: tuple[int, int]) -> float:
    """Return the area of the rectangle around most of the pixels (n, 2), as a fraction of the image."""
    if not len(pixels):
        return 0.0
    low, high = np.quantile(pixels, [_EXTENT_QUANTILE, 1.0 - _EXTENT_QUANTILE], axis=0)
    return float(np.prod(high - low) / (shape[0] * shape[1]))
