# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assembly of stereo pairs of the images of two topics, which arrive one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_core.imaging.pair_rectifier import PAIR_TOLERANCE_NS
from cdff_dev.logs.formats.ros.stereo import StereoTopics
from cdff_dev.logs.source import Unconverted
from cdff_dev.logs.stereo_pairs import matched_stamps

_Index = tuple[NDArray[Any], NDArray[np.int64], dict[str, Unconverted]]


class PairAssembly:
    """Pairs of the images of stereo cameras."""

    def __init__(self, cameras: list[StereoTopics]) -> None:
        self._cameras = cameras
        #: Number of the pair of an image by stream and number of the image.
        self._pair_of: dict[str, dict[int, int]] = {}

    @property
    def streams(self) -> list[str]:
        """Streams of the pairs."""
        return [camera.stream for camera in self._cameras]

    @property
    def replaced(self) -> set[str]:
        """Streams of images that are contained in the pairs without a change."""
        return {
            side.stream
            for camera in self._cameras
            if camera.is_lossless
            for side in (camera.left, camera.right)
        }

    def sources(self, chosen: Collection[str]) -> set[str]:
        """Return the streams of the images of the chosen streams of pairs."""
        cameras = [camera for camera in self._cameras if camera.stream in chosen]
        return {side.stream for camera in cameras for side in (camera.left, camera.right)}

    def index(self, names: NDArray[Any], stamps_ns: NDArray[np.int64]) -> _Index:
        """Return names and stamps with those of the pairs, and the images without a partner.

        Parameters
        ----------
        names : array, shape (n,)
            Stream of each sample, in the order of recording.
        stamps_ns : array, shape (n,)
        """
        all_names, all_stamps_ns = [names], [stamps_ns]
        positions = [np.arange(len(names), dtype=np.float64)]
        unmatched: dict[str, Unconverted] = {}
        for camera in self._cameras:
            left, right = (np.flatnonzero(names == side.stream) for side in (camera.left, camera.right))
            pairs = matched_stamps(stamps_ns[left], stamps_ns[right])
            for side, column in ((camera.left, 0), (camera.right, 1)):
                self._pair_of[side.stream] = {int(number): k for k, number in enumerate(pairs[:, column])}
            if single := len(left) + len(right) - 2 * len(pairs):
                reason = (
                    f"no image of the other camera within {PAIR_TOLERANCE_NS / 1e6:g} ms, for {camera.stream}"
                )
                unmatched[f"single images of {camera.left.name}"] = Unconverted("image", single, reason)
            all_names.append(np.full(len(pairs), camera.stream, dtype=object))
            all_stamps_ns.append(stamps_ns[left[pairs[:, 0]]])
            positions.append(np.maximum(left[pairs[:, 0]], right[pairs[:, 1]]) + 0.5)
        order = np.argsort(np.concatenate(positions), kind="stable")
        return np.concatenate(all_names)[order], np.concatenate(all_stamps_ns)[order], unmatched

    def start(self) -> PairQueue:
        """Return a queue for the images of one reading."""
        return PairQueue(self._cameras, self._pair_of)


class PairQueue:
    """Images of one reading whose partners have not been read yet."""

    def __init__(self, cameras: list[StereoTopics], pair_of: dict[str, dict[int, int]]) -> None:
        self._cameras = {side.stream: camera for camera in cameras for side in (camera.left, camera.right)}
        self._pair_of = pair_of
        self._counts: Counter[str] = Counter()
        self._waiting: dict[tuple[str, int], tuple[int, Any]] = {}

    def add(self, stream: str, stamp_ns: int, content: Any) -> Iterator[tuple[StereoTopics, int, Any]]:
        """Add a sample; yields the pair that it completes: camera, stamp, contents of left and right."""
        if stream not in self._pair_of:
            return
        pair = self._pair_of[stream].get(self._counts[stream])
        self._counts[stream] += 1
        if pair is None:
            return
        camera = self._cameras[stream]
        other = self._waiting.pop((camera.stream, pair), None)
        if other is None:
            self._waiting[camera.stream, pair] = (stamp_ns, content)
        elif stream == camera.left.stream:
            yield camera, stamp_ns, (content, other[1])
        else:
            yield camera, other[0], (other[1], content)
