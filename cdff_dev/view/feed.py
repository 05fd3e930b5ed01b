# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From samples to the layers of a scene, and the frames and streams that it then contains."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cdff_common.geometry import FrameGraph
from cdff_common.interfaces.product import Status
from cdff_common.world.history import POSE_TYPES, frames_of_pose, is_truth
from cdff_dev.logs.source import LogSample
from cdff_dev.view.drawings import (
    BLUE,
    GREY,
    Boxes,
    Ellipsoid,
    Layer,
    Lines,
    Marks,
    Note,
    Number,
    Picture,
    Points,
    Rectangles,
    Scene,
    Surface,
    Transform,
)
from cdff_dev.view.layers import is_drawn, layers_of
from cdff_dev.view.overlays import Overlays

#: Updates of the path of a moving frame; each is the whole path so far.
_PATH_UPDATES = 100
_SPATIAL = (Points, Lines, Surface, Ellipsoid, Boxes, Transform)


@dataclass(slots=True)
class Contents:
    """Frames and layers of a scene, for its layout.

    Attributes
    ----------
    parent_of : dict of str to str
        Parent of each frame.
    spatial, pictures, numbers : dict of str to str
        Frame of each layer in space, of each image, and of each plot ("").
    overlays : dict of str to str
        Image under each layer of marks, rectangles or a further image of the same camera; empty if there is
        none.
    notes : set of str
        Layers with texts.
    not_drawn : Counter
        Number of samples of each type without layers.
    """

    parent_of: dict[str, str] = field(default_factory=dict)
    spatial: dict[str, str] = field(default_factory=dict)
    pictures: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, str] = field(default_factory=dict)
    overlays: dict[str, str] = field(default_factory=dict)
    notes: set[str] = field(default_factory=set)
    not_drawn: Counter[str] = field(default_factory=Counter)

    def root_of(self, frame: str) -> str:
        """Return the root above a frame."""
        while frame in self.parent_of:
            frame = self.parent_of[frame]
        return frame

    def roots(self) -> list[str]:
        """Return the roots above the layers in space, those with most layers first."""
        counts = Counter(self.root_of(frame) for frame in self.spatial.values() if frame)
        return sorted(counts, key=lambda root: (-counts[root], root))

    def robots(self) -> list[str]:
        """Return the first parts of the names of all layers."""
        names = {*self.spatial, *self.pictures, *self.overlays, *self.numbers, *self.notes}
        return sorted({name.split("/")[1] for name in names})

    @property
    def size(self) -> int:
        """Number of layers."""
        return sum(map(len, (self.spatial, self.pictures, self.overlays, self.numbers, self.notes)))

    def add(self, layer: Layer) -> None:
        """Include a layer."""
        drawing = layer.drawing
        if isinstance(drawing, Picture):
            self.pictures[layer.path] = layer.frame
            if drawing.picture:
                self.overlays[layer.path] = drawing.picture
        elif isinstance(drawing, (Marks, Rectangles)):
            self.overlays[layer.path] = drawing.picture
        elif isinstance(drawing, Number):
            self.numbers[layer.path] = ""
        elif isinstance(drawing, _SPATIAL):
            self.spatial[layer.path] = layer.frame
        else:
            self.notes.add(layer.path)


class Feed:
    """Puts samples into a scene, in the order of their stamps.

    A frame has one parent. If several streams state its pose, the frame of the first in ``sources`` has its
    name, the others are named ``{frame}@{stream}``.

    Parameters
    ----------
    sources : mapping of str to str
        Stream of the pose of each frame that has several, see ``sources_of``.
    """

    def __init__(self, scene: Scene, sources: Mapping[str, str] | None = None, path_every: int = 1) -> None:
        self._scene = scene
        self._sources = dict(sources or {})
        self._path_every = max(1, path_every)
        self._paths: dict[str, list[np.ndarray]] = {}
        self._last_ns: dict[str, int] = {}
        self._overlays = Overlays()
        self._is_ok: dict[str, bool] = {}
        self.contents = Contents()

    def add_fixed(self, graph: FrameGraph, stamp_ns: int) -> None:
        """Add fixed frames, from a time on."""
        for child in graph.frames:
            if (parent := graph.parent_of(child)) is not None:
                T = graph.lookup(parent, child, stamp_ns).matrix
                self._put(stamp_ns, Layer(f"/frames/{child}", parent, Transform(parent, child, T)))

    def add(self, sample: LogSample) -> None:
        """Add a sample: its layers, the path of a pose, and the time since the previous sample."""
        path = path_of(sample.stream)
        if sample.value is not None and not is_drawn(sample.value):
            self.contents.not_drawn[sample.type_name] += 1
        for layer in layers_of(path, sample.value, sample.header):
            if isinstance(layer.drawing, Transform) and layer.path == path:
                self._add_pose(sample.stamp_ns, layer, sample.stream)
            else:
                self.add_layer(sample.stamp_ns, layer)
        self._add_recovery(path, sample)
        previous_ns = self._last_ns.get(sample.stream)
        if previous_ns is not None:
            period_s = (sample.stamp_ns - previous_ns) * 1e-9
            self._put(sample.stamp_ns, Layer(f"{path}/timing/period_s", "", Number(period_s)))
        self._last_ns[sample.stream] = sample.stamp_ns

    def add_layer(self, stamp_ns: int, layer: Layer) -> None:
        """Add a layer; a layer in an image is drawn over the image of its camera."""
        for placed_ns, placed in self._overlays.place(stamp_ns, layer):
            self._put(placed_ns, placed)

    def close(self) -> None:
        """Draw the ends of the paths, and the marks without an image."""
        for stamp_ns, layer in self._overlays.end():
            self._put(stamp_ns, layer)
        for path, positions in self._paths.items():
            if positions:
                self._put_path(self._last_ns_of(path), path, positions)

    def _add_recovery(self, path: str, sample: LogSample) -> None:
        """Add a message if the status of a product is OK again."""
        if sample.header is None:
            return
        is_ok = sample.header.quality.status == Status.OK
        if is_ok and not self._is_ok.get(path, True):
            self._put(sample.stamp_ns, Layer(f"{path}/notes", "", Note("INFO", "OK again")))
        self._is_ok[path] = is_ok

    def _add_pose(self, stamp_ns: int, layer: Layer, stream: str) -> None:
        """Add a pose and its path; a frame with several sources gets a name per source."""
        edge = layer.drawing
        assert isinstance(edge, Transform)
        child = edge.child
        if child != edge.parent and self._sources.setdefault(child, stream) != stream:
            child = f"{child}@{stream.removeprefix('/')}"
        if not self._put(
            stamp_ns, Layer(layer.path, edge.parent, Transform(edge.parent, child, edge.matrix))
        ):
            return
        positions = self._paths.setdefault(layer.path, [])
        positions.append(edge.matrix[:3, 3])
        self.contents.spatial.setdefault(f"{layer.path}/path", edge.parent)
        if len(positions) % self._path_every == 0:
            self._put_path(stamp_ns, layer.path, positions)

    def _put_path(self, stamp_ns: int, path: str, positions: list[np.ndarray]) -> None:
        frame = self.contents.spatial[f"{path}/path"]
        colour = GREY if is_truth(path.replace("/truth/", "/truth.")) else BLUE
        self._put(stamp_ns, Layer(f"{path}/path", frame, Lines((np.array(positions),), colour)))

    def _put(self, stamp_ns: int, layer: Layer) -> bool:
        """Put a layer into the scene; return False for an edge that is not one of the tree.

        These are motions of a frame between two times, and edges that contradict earlier ones.
        """
        edge = layer.drawing
        if isinstance(edge, Transform):
            if not self._is_edge(edge):
                return False
            self.contents.parent_of[edge.child] = edge.parent
        self.contents.add(layer)
        self._scene.put(stamp_ns, layer)
        return True

    def _is_edge(self, edge: Transform) -> bool:
        """Return whether an edge has two frames, the parent it had before, and closes no loop."""
        has_frames = bool(edge.parent and edge.child) and edge.parent != edge.child
        has_same_parent = self.contents.parent_of.get(edge.child) in (None, edge.parent)
        return has_frames and has_same_parent and self.contents.root_of(edge.parent) != edge.child

    def _last_ns_of(self, path: str) -> int:
        return next(ns for stream, ns in self._last_ns.items() if path_of(stream) == path)


def path_of(stream: str) -> str:
    """Return the path of the layers of a stream: ``/mana/navcam/pair`` for ``/mana/navcam.pair``."""
    return "/" + stream.strip("/").replace(".", "/")


def sources_of(samples: Iterable[LogSample]) -> dict[str, str]:
    """Return for each frame the stream of its pose: an output ``pose`` before others, true poses last.

    ``samples`` are the first ones of each stream.
    """
    streams: dict[str, list[tuple[bool, bool, str]]] = {}
    for sample in samples:
        if sample.type_name in POSE_TYPES:
            _, child = frames_of_pose(sample.value, sample.header)
            streams.setdefault(child, []).append(
                (is_truth(sample.stream), not sample.stream.endswith(".pose"), sample.stream)
            )
    return {child: min(candidates)[-1] for child, candidates in streams.items()}


def path_interval(count: int) -> int:
    """Return after how many poses a path of ``count`` poses is drawn again."""
    return max(1, count // _PATH_UPDATES)
