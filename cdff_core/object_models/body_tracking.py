# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the compounds that track one known body with its mesh: model, guess, state and outputs."""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.robust import chi_squared_quantile
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import ObjectTrack, TransformWithCovariance
from cdff_core.dfns.model_preparation.interface import ModelPreparationOutputs
from cdff_core.object_models.pose_alternatives import PoseAlternatives
from cdff_core.object_models.prepared import PreparedModels, body_frame
from cdff_core.object_models.scan_detection import Hypothesis
from cdff_core.object_models.state_filter import NewTrackConfig, StateFilter, with_rejection
from cdff_core.object_models.state_output import state_outputs
from cdff_core.object_models.tracked_state import TrackedState


class BodyTrackingConfig(NewTrackConfig):
    """Parameters of the model and of the decision."""

    unit: Literal["m", "mm", "cm", "km"] = Field(
        "m", description="Unit of the vertices of the model; all other lengths are metres"
    )
    centre_of_mass_m: tuple[float, float, float] | None = Field(
        None, description="Centre of mass in the frame of the body, metres; default: the centre of the model"
    )
    centre_of_mass_sigma: float = Field(
        0.15,
        ge=0,
        le=10,
        description="Standard deviation of the centre of mass, relative to the diameter; 0 if it is known",
    )
    gate_probability: float = Field(
        0.99999, gt=0.5, lt=1, description="Probability that a correct measurement agrees with the prediction"
    )


class BodyTracking(Dfpc):
    """Compound that tracks one body; a subclass corrects the predicted state with its measurements."""

    config: BodyTrackingConfig

    def setup_track(self) -> None:
        """Create the DFNs of model and state, clear the state, offer the store item."""
        self._models = PreparedModels(self.dfn("prepare"), self.config.unit)
        self._state_dfns = self.dfn("predict"), self.dfn("correct")
        self._gate = chi_squared_quantile(self.config.gate_probability, 6)
        self._name, self._model_id = "", ""
        self._track_id = 0
        self._last: ObjectTrack | None = None
        self.restart()
        self.store.offer("last_track", lambda: self._last)

    def restart(self) -> None:
        """Clear the track; the next guess or detection starts a new one."""
        self._state: TrackedState | None = None
        self._guess: TransformWithCovariance | None = None
        self._used, self._unused, self._last_used_ns = 0, 0, 0
        self._alternatives = PoseAlternatives.none()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare the mesh; a mesh that differs from the previous one ends the track."""
        previous = self._models.by_name.get(self._name)
        name = self._models.add(sample.value)
        model = self._models.by_name[name]
        if name != self._name or model is not previous:
            guess = self._guess
            self.restart()
            self._guess = guess
        self._name, self._model_id = name, sample.id
        cfg = self.config
        centre_m = model.centre_m if cfg.centre_of_mass_m is None else np.array(cfg.centre_of_mass_m)
        sigma_m = cfg.centre_of_mass_sigma * model.diameter_m
        self._filter = StateFilter(*self._state_dfns, cfg, centre_m, sigma_m)
        return ()

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Store the guess; it starts a track at the next measurement."""
        self._guess = sample.value
        return ()

    @property
    def _model(self) -> ModelPreparationOutputs | None:
        """The prepared model; None before one has arrived."""
        return self._models.by_name.get(self._name)

    @abstractmethod
    def _guess_sigmas(self, model: ModelPreparationOutputs) -> FloatArray:
        """Return the standard deviations (6,) of a guess without covariance, metres and rad."""

    def _start_from_guess(self, model: ModelPreparationOutputs, stamp_ns: int) -> list[str]:
        """Start a track with the guess, if there is one; return the reasons."""
        guess, self._guess = self._guess, None
        if guess is None:
            return []
        # The stamp is just before that of the measurement, which then corrects the guess.
        self._start(model, stamp_ns - 1000, guess.transform)
        self._last_used_ns = stamp_ns
        return ["new_track"]

    def _start(self, model: ModelPreparationOutputs, stamp_ns: int, pose: UncertainTransform) -> None:
        """Start a track with a pose; a missing covariance is replaced by that of a guess."""
        covariance = pose.covariance
        if covariance is None:
            covariance = np.diag(self._guess_sigmas(model) ** 2)
        self._state = self._filter.start(stamp_ns, pose.matrix, covariance)
        self._track_id += 1
        self._used, self._unused = 0, 0
        self._alternatives = PoseAlternatives.none()

    def _not_used(self, predicted: TrackedState, *, is_contradiction: bool) -> None:
        """Continue with a prediction whose measurement was not used."""
        self._state = with_rejection(predicted) if is_contradiction else predicted
        self._unused += 1

    def _use_detection(
        self, model: ModelPreparationOutputs, hypotheses: list[Hypothesis], stamp_ns: int
    ) -> list[str]:
        """Correct the track with a detection that agrees with it, or start a track; return the reasons.

        The state has the time of the detection; the same measurement then corrects it.
        """
        poses = [T for hypothesis in hypotheses for T in hypothesis.T @ model.symmetries]
        agreeing = self._agreeing(model, poses)
        if agreeing is not None:
            self._state = agreeing
            return ["detected"]
        self._start(model, stamp_ns, UncertainTransform(hypotheses[0].T))
        self._alternatives = PoseAlternatives.of(model, [hypothesis.T for hypothesis in hypotheses])
        reasons = ["new_track"]
        reasons += self._ambiguity_reasons()
        reasons += [f"symmetric_model:{len(model.symmetries)}"] if len(model.symmetries) > 1 else []
        return reasons

    def _ambiguity_reasons(self) -> list[str]:
        """Return the reason while other poses explain the measurements nearly as well."""
        return [f"ambiguous:{len(self._alternatives)}"] if len(self._alternatives) else []

    def _agreeing(self, model: ModelPreparationOutputs, poses: Iterable[FloatArray]) -> TrackedState | None:
        """Return the state corrected with the detected pose (4, 4) that agrees best with it; None if none
        agrees.
        """
        predicted = self._state
        if predicted is None:
            return None
        covariance = np.diag(self._guess_sigmas(model) ** 2)
        agreeing = []
        for T in poses:
            with contextlib.suppress(RefusedError):
                agreeing.append(self._filter.corrected(predicted, T, covariance))
        return min(agreeing, key=lambda state: state.squared_distance(predicted), default=None)

    def _published(
        self, sample: Sample, reasons: list[str], metrics: Mapping[str, float]
    ) -> Iterable[Output]:
        """Return the outputs of the state; FAILED if the last used measurement is too old."""
        gap_s = 1e-9 * (sample.stamp_ns - self._last_used_ns)
        lost = [f"lost:{gap_s:.3g}s"] if gap_s > self.config.lost_after_s else []
        all_metrics = {"used": float(self._used), "gap_s": gap_s, **metrics}
        quality = Quality.from_reasons(reasons, CovarianceKind.FORMAL, all_metrics, failed=lost)
        return self._outputs(sample, None if lost else self._state, quality)

    def _outputs(
        self, sample: Sample, state: TrackedState | None, quality: Quality, others: tuple[str, ...] = ()
    ) -> list[Output]:
        """Return the outputs of a state; ``others`` are ids of further inputs."""
        outputs = state_outputs(
            state,
            stamp_ns=sample.stamp_ns,
            frame=self._sensor_frame(sample),
            child=body_frame(self._name or "model"),
            track_id=self._track_id,
            is_confirmed=self._used >= self.config.confirm_after,
            quality=quality,
            inputs=tuple(i for i in (self._model_id, sample.id, *others) if i),
            producer=self.name,
        )
        self._last = outputs[1].value or self._last
        return outputs

    def _sensor_frame(self, sample: Sample) -> str:
        frame: Any = sample.value.frame
        return str(frame)


def order_fault(state: TrackedState, stamp_ns: int) -> str:
    """Return the reason against a measurement that is not newer than the state."""
    age_s = 1e-9 * (state.stamp_ns - stamp_ns)
    return f"late:{age_s:.3g}s" if age_s > 0.0 else "repeated_stamp"
