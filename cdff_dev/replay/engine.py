# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay of a log through one DFPC."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from cdff_common.interfaces.dfpc import Dfpc, Sample
from cdff_core.runtime import Runner
from cdff_dev.logs import LogSource
from cdff_dev.replay.output import ReplayOutput


def samples_of(log: LogSource, wired: Mapping[str, str], robot: str) -> Iterator[Sample]:
    """Yield the samples of a log as samples of ports, in the order (stamp_ns, port, seq).

    ``wired`` maps a port to its stream.
    """
    port_of = {stream: port for port, stream in wired.items()}
    samples = (item.to_sample(port_of[item.stream], robot) for item in log.samples(list(wired.values())))
    for _, batch in groupby(samples, lambda sample: sample.stamp_ns):
        yield from sorted(batch, key=lambda sample: (sample.port, sample.seq))


def paced(samples: Iterable[Sample], speed: float | None) -> Iterator[Sample]:
    """Yield samples at their times, ``speed`` times faster; None yields them without waiting."""
    start_s = time.monotonic()
    first_ns: int | None = None
    for sample in samples:
        if speed is not None:
            first_ns = sample.stamp_ns if first_ns is None else first_ns
            wait_s = (sample.stamp_ns - first_ns) * 1e-9 / speed - (time.monotonic() - start_s)
            if wait_s > 0:
                time.sleep(wait_s)
        yield sample


def replay(
    dfpc: Dfpc,
    samples: Iterable[Sample],
    out: Path | None,
    on_sample: Callable[[Sample], None] | None = None,
) -> dict[str, Any]:
    """Pass samples to a configured DFPC and write its outputs.

    Parameters
    ----------
    out : Path or None
        Folder for ``outputs.msg``, ``summary.json`` and ``<port>.tum``; None writes nothing.
    on_sample : callable or None
        Called after each sample, for progress.

    Returns
    -------
    dict
        The summary: counts, wall and CPU seconds, peak memory, configuration hash.

    Raises
    ------
    StorageError
        If ``out`` cannot be written.
    """
    runner, output = Runner(dfpc), ReplayOutput(out)
    try:
        for sample in samples:
            runner.push(sample)
            output.write(runner.drain())
            if on_sample is not None:
                on_sample(sample)
        output.write(runner.finish())
    finally:
        output.close()
    counters = runner.counters.to_dict()
    names = (
        "samples",
        "outputs",
        "degraded",
        "failed",
        "errors",
        "last_error",
        "last_failure",
        "out_of_order",
    )
    return output.write_summary(
        {
            "dfpc": dfpc.name,
            "implementation": dfpc.implementation,
            "config_hash": dfpc.config_hash,
            "dropped": counters["late"],
            **{name: counters[name] for name in (*names, "samples_by_port", "outputs_by_port")},
        }
    )
