# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay of a whole mission: requests switch DFPCs and sensors on and off, as on the robot, on recorded data."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Product, Quality, product_id
from cdff_common.interfaces.profile import Profile
from cdff_common.output import make_folder, write_file
from cdff_dev.logs import LogSample, LogSource, LogWriter
from cdff_dev.play.gate import SensorGate
from cdff_dev.play.player import playable
from cdff_dev.play.prefetch import split_stream
from cdff_dev.replay.engine import PoseLines

#: Where services offer to run a mission; the toolkit imports none of them.
_GROUP = "cdff.rehearsal"


def replay_mission(
    log: LogSource, profile: Profile, requests: Path, out: Path, store: Path | None = None
) -> dict[str, Any]:
    """Run a mission on a log and write what came of it.

    Parameters
    ----------
    log : LogSource
        Sensor streams of the profile's robots; others, and recorded products, are passed over.
    profile : Profile
    requests : Path
        Script of requests (``services/rehearsal/script.py``).
    out : Path
        Folder for ``outputs.msg``, ``{robot}.{dfpc}.{port}.tum``, ``answers.json``, ``answers/``, ``journal.jsonl`` and
        ``summary.json``.
    store : Path, optional
        Directory of a DPM to store the products into.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        If the log holds nothing of the profile's robots, or the script is malformed.
    ConfigurationError
        If no services are installed.
    """
    found = tuple(entry_points(group=_GROUP))
    if not found:
        raise ConfigurationError(
            "no services are installed: a mission needs the orchestrator; replay one DFPC with --dfpc"
        )
    rehearse = found[0].load()
    streams = _streams(log, profile)
    start_ns = min(log.streams[s].t0_ns for s in streams)
    make_folder(out)
    wall_s, cpu_s = time.monotonic(), time.process_time()
    tracks: dict[str, PoseLines] = {}
    with LogWriter(out / "outputs.msg") as writer:

        def keep(product: Product) -> None:
            if product.value is None:
                return
            name = f"{product.robot}.{product.dfpc}.{product.port}"
            writer.write(
                f"/{product.robot}/{product.dfpc}.{product.port}", product.value, product.header.t1_ns, product.header
            )
            if product.type_name == "TransformWithCovariance":
                tracks.setdefault(name, PoseLines()).add(product.header.t1_ns, product.value.transform.matrix)

        told = rehearse(profile, _samples(log, streams), start_ns, requests, SensorGate(), keep, out, store)
    answers = told.pop("answers")
    summary: dict[str, Any] = {
        "mission": profile.name,
        **told,
        "requests": len(answers),
        "answered": sum(a["answer"] != "error" for a in answers),
        "wall_s": time.monotonic() - wall_s,
        "cpu_s": time.process_time() - cpu_s,
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    for name, track in tracks.items():
        write_file(out / f"{name}.tum", ("\n".join(track.lines) + "\n").encode())
    write_file(out / "summary.json", (json.dumps(summary, indent=2, sort_keys=True) + "\n").encode())
    return {**summary, "answers": answers}


def _streams(log: LogSource, profile: Profile) -> list[str]:
    """Sensor streams that the profile knows; raises InputError where there are none, or one is of another type."""
    chosen = []
    for stream in playable(log):
        robot, sensor, name = split_stream(stream)
        sensors = profile.robot(robot).sensors if robot in profile.robot_ids else {}
        expected = sensors[sensor].streams.get(name) if sensor in sensors else None
        if expected is None:
            continue
        if expected != log.streams[stream].type_name:
            held = log.streams[stream].type_name
            raise InputError(f"stream {stream} holds {held}, profile {profile.name} expects {expected}")
        chosen.append(stream)
    if not chosen:
        raise InputError(f"profile {profile.name} knows none of the log's streams: {', '.join(sorted(log.streams))}")
    return chosen


def _samples(log: LogSource, streams: list[str]) -> Iterator[tuple[str, str, Sample]]:
    for item in log.samples(streams):
        robot, sensor, stream = split_stream(item.stream)
        yield robot, f"sensor/{sensor}/{stream}", _sample(item, robot, sensor, stream)


def _sample(item: LogSample, robot: str, sensor: str, stream: str) -> Sample:
    header = item.header
    return Sample(
        port="",
        stamp_ns=item.stamp_ns,
        seq=item.seq,
        value=item.value,
        id=header.id if header else product_id(robot, sensor, stream, item.stamp_ns, item.seq, ""),
        frame=header.frame if header else "",
        child=(header.child or "") if header else "",
        quality=header.quality if header else Quality(),
    )
