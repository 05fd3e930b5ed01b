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
from cdff_common.interfaces.product import Product
from cdff_core.runtime import Runner
from cdff_dev.logs import LogSource
from cdff_dev.replay.conditions import Condition
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
    on_product: Callable[[Product], None] | None = None,
    until: Condition | None = None,
    plot: Path | None = None,
) -> dict[str, Any]:
    """Pass samples to a configured DFPC and write its outputs.

    Parameters
    ----------
    out : Path or None
        Folder for ``outputs.msg``, ``summary.json``, ``<port>.tum``, and the last map, graph and cloud;
        None writes nothing.
    on_sample, on_product : callable or None
        Called after each sample, and for each product.
    until : Condition or None
        End after the first product that fulfils it; the summary then has ``stopped``.
    plot : Path, optional
        Picture of the paths and of the last values.

    Returns
    -------
    dict
        The summary: counts, wall and CPU seconds, peak memory, configuration hash.

    Raises
    ------
    StorageError
        If ``out`` cannot be written.
    """
    absolute = {port.attribute for port in dfpc.description.output_ports if port.absolute}
    runner, output = Runner(dfpc), ReplayOutput(out, absolute=absolute)
    stopped: dict[str, Any] | None = None
    try:
        for sample in samples:
            runner.push(sample)
            stopped = _pass_on(runner.drain(), output, on_product, until)
            if on_sample is not None:
                on_sample(sample)
            if stopped is not None:
                break
        else:
            stopped = _pass_on(runner.finish(), output, on_product, until)
        output.write_items(dfpc)
    finally:
        output.close()
    if plot is not None:
        from cdff_common.plots import figure_of, write_figure

        write_figure(plot, figure_of(output.drawn_values()))
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
            "stopped": stopped,
            "dropped": counters["late"],
            "unknown_frames": runner.sensors.unknown_frames,
            "sensor_findings": [finding.to_dict() for finding in runner.sensors.history],
            **{name: counters[name] for name in (*names, "samples_by_port", "outputs_by_port")},
        }
    )


def _pass_on(
    products: Iterable[Product],
    output: ReplayOutput,
    on_product: Callable[[Product], None] | None,
    until: Condition | None,
) -> dict[str, Any] | None:
    """Write the products; at the first one that meets the condition, stop and return its description."""
    for product in products:
        output.write([product])
        if on_product is not None:
            on_product(product)
        if until is not None and until.holds(product):
            quality = product.header.quality
            return {
                "condition": until.text,
                "port": product.port,
                "t1_ns": product.header.t1_ns,
                "status": quality.status.name,
                "reasons": list(quality.reasons),
            }
    return None
