# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay LOG --requests FILE``: replay of a mission on a recorded log."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from cdff_common.plots import figure_of, write_figure
from cdff_common.progress import counted
from cdff_dev.logs.source import LogSource, split_stream
from cdff_dev.mission_replay.mission import LogClock, MissionReplay, RecordedSample
from cdff_dev.mission_replay.report import write_answers
from cdff_dev.mission_replay.script import read_script
from cdff_dev.play.start import playable
from cdff_dev.replay.output import ReplayOutput
from dpm_store import Store, open_store


def replay_mission(
    log: LogSource,
    profile: Profile,
    requests: Path,
    out: Path,
    store: Path | None = None,
    plot: Path | None = None,
) -> dict[str, Any]:
    """Replay a mission on a log; write its outputs and the answers to its requests.

    Parameters
    ----------
    log : LogSource
        The sensor streams of the profile are replayed; other streams and recorded products are skipped.
    profile : Profile
    requests : Path
        Script of requests (``cdff_dev/mission_replay/script.py``).
    out : Path
        Folder for ``outputs.msg``, ``{robot}.{dfpc}.{port}.tum``, ``answers.json``, ``answers/``,
        ``journal.jsonl`` and ``summary.json``.
    store : Path, optional
        Directory of the DPM that stores the products; by default a temporary one.
    plot : Path, optional
        Picture of the paths and of the last values of the outputs.

    Returns
    -------
    dict
        The summary with ``answers``.

    Raises
    ------
    InputError
        If the log contains no stream of the profile's robots, or the script is malformed.
    StorageError
        If the store or the folder cannot be used.
    """
    streams = _streams(log, profile)
    start_ns = min(log.streams[s].t0_ns for s in streams)
    output = ReplayOutput(out, full_names=True)
    with ExitStack() as stack:
        stack.callback(output.close)
        script = read_script(requests, start_ns, profile.robot_ids)
        journal = out / "journal.jsonl"
        journal.unlink(missing_ok=True)
        directory = store or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="cdff-replay-")))

        def open_dpm_store(clock: LogClock) -> Store:
            return stack.enter_context(open_store(f"sqlite:///{directory}", clock))

        replay = MissionReplay(
            profile, start_ns, open_dpm_store, journal, lambda product: output.write([product])
        )
        samples = counted(_samples(log, streams), sum(log.streams[s].count for s in streams), "samples")
        answers = write_answers(out, replay.run(samples, script), start_ns)
        stored = sum(replay.store.statistics().products.values())
    if plot is not None:
        write_figure(plot, figure_of(output.drawn_values()))
    summary = output.write_summary(
        {
            "mission": profile.name,
            "samples": replay.delivered,
            "gated": replay.gated,
            "dfpcs": {f"{robot}/{name}": dfpc.totals for (robot, name), dfpc in replay.dfpcs.items()},
            "stored": stored,
            "requests": len(answers),
            "answered": sum(a["answer"] != "error" for a in answers),
        }
    )
    return {**summary, "answers": answers}


def _streams(log: LogSource, profile: Profile) -> list[str]:
    """Return the streams of the log that are sensor streams of the profile.

    Raises InputError if there is none, or the type of one differs.
    """
    selected = []
    for stream in playable(log):
        robot, sensor, name = split_stream(stream)
        sensors = profile.robot(robot).sensors if robot in profile.robot_ids else {}
        expected = sensors[sensor].streams.get(name) if sensor in sensors else None
        if expected is None:
            continue
        recorded = log.streams[stream].type_name
        if expected != recorded:
            raise InputError(
                f"stream {stream} contains {recorded}, profile {profile.name} expects {expected}"
            )
        selected.append(stream)
    if not selected:
        listed_streams = ", ".join(sorted(log.streams))
        raise InputError(f"profile {profile.name} has none of the log's streams: {listed_streams}")
    return selected


def _samples(log: LogSource, streams: list[str]) -> Iterator[RecordedSample]:
    for item in log.samples(streams):
        robot, sensor, stream = split_stream(item.stream)
        yield RecordedSample(robot, sensor, stream, item.to_sample("", robot))
