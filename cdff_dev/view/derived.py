# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Disparities and features for the viewer, computed from the images of a log."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator
from typing import Any

from cdff_common.errors import CdffError
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Frame, FramePair, VisualPointFeatureVector2D
from cdff_core.dfns.disparity_image.interface import Inputs as DisparityInputs
from cdff_core.dfns.features_extraction_2d.interface import Inputs as FeatureInputs
from cdff_dev.logs.source import LogSample, recorded_header
from cdff_dev.view.layers import picture_of

logger = logging.getLogger(__name__)

DISPARITY, FEATURES = "disparity", "features"
#: Weights of red, green and blue in the brightness, ITU-R BT.601.
_BRIGHTNESS = (0.299, 0.587, 0.114)


class Deriver:
    """Computes disparities of stereo pairs and features of images with the DFNs of the same names.

    Parameters
    ----------
    names : collection of str
        ``disparity``, ``features``, or none.
    """

    def __init__(self, names: Collection[str]) -> None:
        self._names = names
        self._refused: Counter[str] = Counter()
        if not names:
            return
        registry = Registry.default()
        self._matcher: Any = registry.make_dfn("disparity_image")
        self._extractor: Any = registry.make_dfn("features_extraction_2d", "Orb")
        for node in (self._matcher, self._extractor):
            node.configure({})

    def derived(self, sample: LogSample) -> list[LogSample]:
        """Return the samples computed from an image sample; images that a DFN refuses are counted."""
        if not self._names or not isinstance(sample.value, (Frame, FramePair)):
            return []
        try:
            return [*self._derive(sample)]
        except CdffError as error:
            self._refused[str(error)] += 1
            return []

    def close(self) -> None:
        """Log the numbers of refused images by reason."""
        for reason, count in self._refused.items():
            logger.warning("nothing derived from %d images: %s", count, reason)

    def _derive(self, sample: LogSample) -> Iterator[LogSample]:
        """Yield image features and disparity computed from an image or pair."""
        value: Any = sample.value
        image: Frame = value.left if isinstance(value, FramePair) else value
        if FEATURES in self._names:
            image_features = self._extractor.process(FeatureInputs(image=_grey(image))).features
            features = VisualPointFeatureVector2D.from_arrays(image_features)
            yield _sample(sample, FEATURES, "VisualPointFeatureVector2D", features, image.frame)
        if DISPARITY in self._names and isinstance(value, FramePair):
            disparity = self._matcher.process(DisparityInputs(left=value.left, right=value.right)).disparity
            yield _sample(sample, DISPARITY, "Frame", disparity, image.frame)


def _sample(source: LogSample, name: str, type_name: str, value: Any, frame: str) -> LogSample:
    stream = f"{source.stream}_{name}"
    header = recorded_header(stream, source.seq, source.stamp_ns, frame=frame)
    return LogSample(stream, type_name, source.stamp_ns, source.seq, value, header)


def _grey(image: Frame) -> Any:
    """Return the pixels ``(rows, cols)`` with 8 bits."""
    pixels = picture_of(image)
    return pixels if pixels.ndim == 2 else (pixels @ _BRIGHTNESS).astype("uint8")
