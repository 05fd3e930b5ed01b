# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common part of the compounds that localise a model in scenes: model, guess, waiting scene and output."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import Generic

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import TransformWithCovariance
from cdff_core.cloud_matching.reference import PreparedT, ReferenceCloud


class ModelLocalisation(Dfpc, Generic[PreparedT]):
    """Compound that localises a model in each scene; a subclass registers the clouds."""

    def setup_model(self, prepare: Callable[[Sample], PreparedT]) -> None:
        """Clear the state, offer the store item; ``prepare`` is that of ``ReferenceCloud``."""
        self._model = ReferenceCloud(prepare)
        self._guess: Sample | None = None
        self._last: TransformWithCovariance | None = None
        self.store.offer("model", self._model.cloud)

    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Store the guess."""
        self._guess = sample
        return ()

    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Prepare and store the model; process the scene that waited for one."""
        waiting = self._model.replace(sample)
        return () if waiting is None else self.on_scene(waiting)

    def on_scene(self, sample: Sample) -> Iterable[Output]:
        """Localise the model in the scene; without a model the scene waits."""
        if self._model.sample is None:
            self._model.waiting = sample
            return ()
        T: UncertainTransform | None = None
        try:
            T, quality = self._localise(self._model.prepared(), sample)
        except (InputError, RefusedError) as error:
            quality = Quality.from_error(error)
        output = Output.of_pose(
            "pose",
            T,
            stamp_ns=sample.stamp_ns,
            frame=sample.value.frame,
            child=self._model.frame,
            quality=quality,
            inputs=(self._model.id, sample.id, self._guess.id if self._guess else ""),
            producer=self.name,
        )
        self._last = output.value or self._last
        return [output]

    @abstractmethod
    def _localise(self, model: PreparedT, sample: Sample) -> tuple[UncertainTransform | None, Quality]:
        """Return ``T_scene_model``, None if it is refused, and its quality."""
