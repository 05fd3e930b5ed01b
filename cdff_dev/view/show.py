# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs, runs and the running system in an output."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from cdff_common.progress import Progress
from cdff_common.world.history import is_static
from cdff_dev.logs.opened import opened
from cdff_dev.logs.source import LogSample, LogSource
from cdff_dev.view.derived import Deriver
from cdff_dev.view.drawings import Layer
from cdff_dev.view.feed import Contents, Feed, path_interval, sources_of
from cdff_dev.view.models import ModelLayers
from cdff_dev.view.outputs import Output


@dataclass(frozen=True, slots=True)
class Selection:
    """Part of the logs to show.

    Attributes
    ----------
    streams : collection of str or None
        None for all.
    t0_ns, t1_ns : int or None
        Interval of stamps.
    profile : Profile or None
        Fixed frames of the robots.
    derived : collection of str
        ``disparity``, ``features``: to be computed from the images.
    models : sequence of str
        Files of meshes to be drawn at the poses of their frames.
    unit : str
        Unit of the meshes.
    """

    streams: Collection[str] | None = None
    t0_ns: int | None = None
    t1_ns: int | None = None
    profile: Profile | None = None
    derived: Collection[str] = ()
    models: Sequence[str] = ()
    unit: str = "m"

    def of(self, log: LogSource) -> list[str]:
        """Return the selected streams of a log."""
        return [name for name in log.streams if self.streams is None or name in self.streams]

    def contains(self, stamp_ns: int) -> bool:
        """Return whether a stamp is in the interval."""
        return (self.t0_ns is None or stamp_ns >= self.t0_ns) and (
            self.t1_ns is None or stamp_ns <= self.t1_ns
        )


def show_logs(output: Output, paths: Sequence[tuple[str, Path | None]], selection: Selection) -> str:
    """Show logs, each with the calibration of its cameras or None, together; return a summary.

    Raises
    ------
    InputError
        If no stream is selected, or no sample is in the interval.
    """
    with ExitStack() as stack:
        logs = [stack.enter_context(opened(path, calibration)) for path, calibration in paths]
        chosen = [(log, names) for log in logs if (names := selection.of(log))]
        static: list[LogSample] = []
        if any(not is_static(name) for _, names in chosen for name in names):
            chosen, static = _without_static(chosen)
        infos = [log.streams[name] for log, names in chosen for name in names]
        if not infos:
            known = ", ".join(name for log in logs for name in log.streams) or "none"
            raise InputError(f"--stream {selection.streams}: the logs have {known}")
        sources = sources_of([*_first_samples(chosen), *static])
        n = sum(info.count for info in infos)
        feed = Feed(output.scene, sources, path_interval(max(info.count for info in infos)))
        samples = heapq.merge(*(log.samples(names) for log, names in chosen), key=_order)
        progress, count = Progress(n, "samples"), 0
        deriver, models = Deriver(selection.derived), ModelLayers(selection.models, selection.unit)
        for sample in samples:
            progress.advance()
            if not selection.contains(sample.stamp_ns):
                continue
            if not count:
                _add_profile(feed, selection.profile, sample.stamp_ns)
                for item in static:
                    feed.add(replace(item, stamp_ns=sample.stamp_ns))
                _add_layers(feed, models.surfaces(), sample.stamp_ns)
            for item in (sample, *deriver.derived(sample)):
                feed.add(item)
            _add_layers(feed, models.layers_of(sample), sample.stamp_ns)
            count += 1
        progress.close()
        deriver.close()
    if not count:
        raise InputError(f"{', '.join(path for path, _ in paths)}: no sample between --t0 and --t1")
    feed.close()
    output.arrange(feed.contents)
    return summary_text(output, feed.contents, count)


def show_live(output: Output, connect: str | None, selection: Selection, duration_s: float | None) -> str:
    """Show the published samples and products until interrupted, or until the duration is over."""
    from cdff_dev.view.live import live_updates

    feed, deriver, count, arranged = Feed(output.scene), Deriver(selection.derived), 0, 0
    models = ModelLayers(selection.models, selection.unit)
    try:
        for update in live_updates(connect, duration_s):
            if isinstance(update, tuple):
                feed.add_layer(*update)
            elif selection.streams is None or update.stream in selection.streams:
                if not count:
                    _add_profile(feed, selection.profile, update.stamp_ns)
                    _add_layers(feed, models.surfaces(), update.stamp_ns)
                for sample in (update, *deriver.derived(update)):
                    feed.add(sample)
                _add_layers(feed, models.layers_of(update), update.stamp_ns)
                count += 1
            if feed.contents.size > arranged:
                arranged = feed.contents.size
                output.arrange(feed.contents)  # the layout with the new layers
    except KeyboardInterrupt:
        pass
    deriver.close()
    feed.close()
    output.arrange(feed.contents)
    return summary_text(output, feed.contents, count)


def summary_text(output: Output, contents: Contents, count: int) -> str:
    """Return the numbers of samples, layers and images, the place, and the types that are not drawn."""
    lines = [
        f"{count} samples, {len(contents.spatial)} layers in {len(contents.roots())} spaces, "
        f"{len(contents.pictures)} images: {output.place}"
    ]
    for type_name, number in sorted(contents.not_drawn.items()):
        lines.append(f"not drawn: {number} {type_name}")
    return "\n".join(lines)


def _without_static(
    chosen: Sequence[tuple[LogSource, list[str]]],
) -> tuple[list[tuple[LogSource, list[str]]], list[LogSample]]:
    """Return the other streams of each log, and the first sample of each static stream."""
    static: list[LogSample] = []
    others = []
    for log, names in chosen:
        static += log.first_samples([name for name in names if is_static(name)]).values()
        if moving := [name for name in names if not is_static(name)]:
            others.append((log, moving))
    return others, static


def _first_samples(chosen: Sequence[tuple[LogSource, list[str]]]) -> list[LogSample]:
    """Return the first sample of each stream with poses."""
    from cdff_common.world.history import POSE_TYPES

    samples: list[LogSample] = []
    for log, names in chosen:
        samples += log.first_samples([n for n in names if log.streams[n].type_name in POSE_TYPES]).values()
    return samples


def _order(sample: LogSample) -> tuple[int, str, int]:
    """Return the key by which samples of several logs are ordered."""
    return sample.stamp_ns, sample.stream, sample.seq


def _add_layers(feed: Feed, layers: Iterable[Layer], stamp_ns: int) -> None:
    for layer in layers:
        feed.add_layer(stamp_ns, layer)


def _add_profile(feed: Feed, profile: Profile | None, stamp_ns: int) -> None:
    for robot in profile.robots if profile else ():
        feed.add_fixed(robot.frame_graph(), stamp_ns)
