# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""far_range_tracking on simulated images of distant rovers: continuity, identity, place, range.

The scenes have seeds of their own, with terrain, rocks, sun, paths and distances. The truth of a place is the
centre of the visible area with enclosed gaps filled. Ranges are measured by each source alone and by all.

References
----------
.. [1] Bernardin, K., Stiefelhagen, R. (2008). Evaluating multiple object tracking performance: the CLEAR MOT
   metrics. EURASIP Journal on Image and Video Processing. doi:10.1155/2008/246309
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import (
    ElevationMap,
    Frame,
    FramePair,
    ObjectTrackStatusT,
    TransformWithCovariance,
)
from cdff_dev.simulate.world import true_heights
from evaluation.scenes.distant_rovers import Renderer, TrueImage, TrueObject, scene

PARTS = ("crossing", "driving", "small")
OPTIONS = {"seed": 1, "count": 3}
_EPOCH_NS = 1_700_000_000_000_000_000
#: Cell size of the elevation map, metres, and the errors of the pose of the observer.
_CELL_M, _POSE_M, _POSE_RAD = 0.2, 0.02, 2e-4
#: Sizes, pixels, from which tracking and range are assessed.
_LEAST_PX, _RANGE_PX = 6.0, 20.0
_CONFIRMED, _COASTING = ObjectTrackStatusT.TRACK_CONFIRMED, ObjectTrackStatusT.TRACK_COASTING
#: Inputs of each run: image only; with height; pair and pose; image, pose and map; everything.
RUNS = ("image", "height", "stereo", "terrain", "all")


def evaluate(
    data: Path,
    progress: Callable[[str], None],
    parts: tuple[str, ...] = PARTS,
    seed: int = 1,
    count: int = 3,
) -> dict[str, Any]:
    """Return the figures of the parts over ``count`` scenes each, with the seeds from ``100 * seed``."""
    cv2.setNumThreads(1)
    figures: dict[str, Any] = {}
    for kind in parts:
        runs = ("image", "all") if kind == "small" else RUNS if kind == "crossing" else ("all",)
        results: dict[str, list[_Pass]] = {run: [] for run in runs}
        for k in range(count):
            progress(f"far_range_tracking: {kind}, scene {k + 1} of {count}")
            renderer = Renderer(scene(kind, 100 * seed + k))
            images = list(renderer.images())
            for run in runs:
                results[run].append(_Pass(renderer, images, run))
        figures[kind] = {"scenes": count, "images": sum(len(p.images) for p in results[runs[0]])}
        figures[kind] |= {run: _summary(results[run]) for run in runs}
    return figures


class _Pass:
    """One scene tracked with some of the inputs."""

    def __init__(self, renderer: Renderer, images: list[TrueImage], run: str) -> None:
        self.images, self.run = images, run
        self._renderer = renderer
        self.rows: list[list[Any]] = []
        self.cpu_s = 0.0
        model = renderer.scenario.rovers_in_view
        assert model is not None
        dfpc = Registry.default().make_dfpc("far_range_tracking")
        parameters = {"target_height_m": model.height_m} if run in ("height", "all") else {}
        dfpc.configure(parameters, DfpcContext("mana"))
        if run in ("terrain", "all"):
            dfpc.step(self._dem())
        for k, image in enumerate(images):
            samples = self._samples(k, image)
            start_s = time.process_time()
            outputs = [o for s in samples for o in dfpc.step(s)]
            self.cpu_s += time.process_time() - start_s
            self.rows.append([o.value for o in outputs if o.port == "track"])

    def _samples(self, k: int, image: TrueImage) -> list[Sample]:
        stamp_ns = _EPOCH_NS + round(image.time_s * 1e6) * 1000
        camera, frame = self._renderer.navcam.camera_matrix, "mana/camera"
        samples = []
        if self.run in ("stereo", "terrain", "all"):
            covariance = np.diag([_POSE_M**2] * 3 + [_POSE_RAD**2] * 3)
            pose = TransformWithCovariance.from_transform(
                UncertainTransform(image.T_site_camera, covariance),
                parent="site",
                child=frame,
                stamp_ns=stamp_ns,
            )
            samples.append(Sample("pose", stamp_ns, k, pose, frame="site", child=frame))
        if self.run in ("stereo", "all"):
            pair = FramePair.from_images(
                image.left,
                image.right,
                baseline_m=self._renderer.navcam.baseline_m,
                camera_matrix=camera,
                stamp_ns=stamp_ns,
                sensor=frame,
            )
            return [*samples, Sample("pair", stamp_ns, k, pair, frame=frame)]
        value = Frame.from_image(image.left, stamp_ns=stamp_ns, sensor=frame, camera_matrix=camera)
        return [*samples, Sample("image", stamp_ns, k, value, frame=frame)]

    def _dem(self) -> Sample:
        layers = true_heights(self._renderer.world, _CELL_M)
        n = layers["mean"].shape[0]
        half = self._renderer.scenario.terrain.fine_half_width_m
        grid = GridGeometry("site", _CELL_M, -half, half, n, n)
        layers["variance"] = np.maximum(layers["variance"], 0.02**2).astype(np.float32)
        dem = ElevationMap.from_layers(
            grid, {k: layers[k] for k in ("mean", "variance")}, t0_ns=_EPOCH_NS, t1_ns=_EPOCH_NS
        )
        return Sample("dem", _EPOCH_NS, 0, dem, frame="site")

    def tracks_of_objects(self, k: int, numbers: dict[str, int]) -> dict[str, Any]:
        """Return the tracks of the objects in an image; each track belongs to one object at most [1]_.

        An object keeps its track, given by its number, as long as that is at its place. The other objects
        get the other tracks, confirmed and nearest ones first.
        """
        objects = self.images[k].objects
        near = sorted(
            (
                track.metadata.track_id != numbers.get(name),
                track.metadata.status is not _CONFIRMED,
                distance,
                name,
                j,
            )
            for name, truth in objects.items()
            for j, track in enumerate(self.rows[k])
            if (distance := float(np.linalg.norm(track.data.pixels[0] - truth.place_px)))
            < max(3.0, 0.4 * float(truth.size_px.max()))
        )
        rows: dict[str, int] = {}
        for *_, name, j in near:
            if name not in rows and j not in rows.values():
                rows[name] = j
        return {name: self.rows[k][j] for name, j in rows.items()}


def _is_shown(truth: TrueObject) -> bool:
    """Return True if an object is large and visible enough for tracking."""
    return truth.visible >= 0.5 and bool((truth.size_px >= _LEAST_PX).all())


@dataclass(slots=True)
class _Followed:
    """Progress of one object through the images of a scene."""

    number: int | None = None
    started_s: float | None = None
    hidden_s: float = 0.0
    was_hidden: bool = False
    errors: list[FloatArray] = field(default_factory=list)


def _summary(passes: list[_Pass]) -> dict[str, Any]:
    """Return the figures of the passes of one run."""
    expected = followed_images = changes = false = 0
    latency: list[float] = []
    hidden_objects = 0
    about_mean, absolute, ranges, squares, places = [], [], [], [], []
    objects = [_Followed() for p in passes for _ in p.images[0].objects]
    remaining = iter(objects)
    for p in passes:
        matched_numbers: set[int] = set()
        of_scene = {name: next(remaining) for name in p.images[0].objects}
        for k, image in enumerate(p.images):
            numbers = {name: o.number for name, o in of_scene.items() if o.number is not None}
            tracks = p.tracks_of_objects(k, numbers)
            for name, o in of_scene.items():
                truth, track = image.objects[name], tracks.get(name)
                is_shown = _is_shown(truth)
                if truth.is_moving and is_shown and o.started_s is None:
                    o.started_s = image.time_s
                o.hidden_s = o.hidden_s + 0.5 if o.number is not None and truth.visible < 0.5 else 0.0
                o.was_hidden = o.was_hidden or o.hidden_s >= 10.0
                if not is_shown:
                    continue
                expected += o.number is not None
                if track is None:
                    continue
                number = int(track.metadata.track_id)
                if o.number is None:
                    o.number = number
                    latency.append(image.time_s - (image.time_s if o.started_s is None else o.started_s))
                    continue
                followed_images += number == o.number
                changes += number != o.number
                o.number = number
                matched_numbers.add(number)
                if truth.visible > 0.98 and track.metadata.status is _CONFIRMED:
                    data = track.data
                    o.errors.append(data.pixels[0] - truth.place_px)
                    if truth.size_px[1] >= _RANGE_PX and np.isfinite(data.bearings[0, 4]):
                        difference = float(data.bearings[0, 4]) - truth.range_m
                        ranges.append(difference / truth.range_m)
                        squares.append((difference / float(data.bearings[0, 5])) ** 2)
                    places.append(float(data.pixel_sigmas[0].mean()))
        hidden_objects += sum(o.was_hidden for o in of_scene.values())
        for o in of_scene.values():
            if len(o.errors) > 5:
                errors = np.array(o.errors)
                absolute.append(errors)
                about_mean.append(errors - errors.mean(axis=0))
        confirmed = {t.metadata.track_id for rows in p.rows for t in rows if t.metadata.status is _CONFIRMED}
        false += len(confirmed - matched_numbers)
    summary: dict[str, Any] = {
        "objects": len(objects),
        "never_confirmed": sum(o.number is None for o in objects),
        "confirmed_after_s": {
            "median": round(float(np.median(latency)), 1) if latency else None,
            "largest": round(float(np.max(latency)), 1) if latency else None,
        },
        "continuity": round(followed_images / max(expected, 1), 4),
        "changes_of_number": changes,
        "hidden_for_10_s": hidden_objects,
        "false_tracks": false,
        "rms_px": _rms(absolute),
        "rms_about_mean_px": _rms(about_mean),
        "stated_sigma_px": round(float(np.median(places)), 3) if places else None,
        "cpu_ms_per_image": round(1e3 * sum(p.cpu_s for p in passes) / sum(len(p.images) for p in passes), 1),
    }
    if ranges:
        range_errors = 100.0 * np.abs(ranges)
        summary["range_per_cent"] = {
            "images": len(ranges),
            "median": round(float(np.median(range_errors)), 2),
            "p95": round(float(np.percentile(range_errors, 95)), 2),
            "mean": round(100.0 * float(np.mean(ranges)), 2),
            "squared_error": round(float(np.mean(squares)), 2),
        }
    return summary


def _rms(errors: list[FloatArray]) -> list[float] | None:
    """Return the root mean square of columns and rows."""
    if not errors:
        return None
    rms = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    return [round(float(x), 3) for x in rms]


def table(figures: dict[str, Any]) -> str:
    """Return the table of the page."""
    lines = [
        "| scenes | inputs | objects | confirmed after (median), s | continuity | changes of number "
        "| false tracks |"
        " rms about mean, px (u, v) | range error, median / 95 %, % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, values in figures.items():
        for run in RUNS:
            if run not in values:
                continue
            v = values[run]
            rms = v["rms_about_mean_px"]
            ranges = v.get("range_per_cent")
            lines.append(
                f"| {kind} ({values['scenes']}) | {run} | {v['objects']} |"
                f" {v['confirmed_after_s']['median']} |"
                f" {100.0 * v['continuity']:.1f} % | {v['changes_of_number']} | {v['false_tracks']} |"
                f" {'–' if rms is None else f'{rms[0]:.2f}, {rms[1]:.2f}'} |"
                f" {'–' if ranges is None else '{} / {}'.format(ranges['median'], ranges['p95'])} |"
            )
    return "\n".join(lines)
