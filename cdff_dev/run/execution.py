# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run one DFN or DFPC once."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from cdff_common.errors import CdffError, RefusedError
from cdff_common.interfaces.description import OutputPort, Port
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status, worst
from cdff_common.interfaces.registry import Registry
from cdff_dev.run.inputs import ROBOT, read_inputs


@dataclass(frozen=True, slots=True, eq=False)
class Emitted:
    """Value of an output port; None if it was refused."""

    value: Any
    covariance_kind: CovarianceKind = CovarianceKind.NONE


@dataclass(slots=True)
class Result:
    """Result of a run.

    Attributes
    ----------
    name : str
        Folder of the DFN or DFPC.
    ports : tuple of Port
        Output ports.
    outputs : dict of str to list of Emitted
        By port attribute, in the order in which they came.
    quality : Quality
        Worst status over all outputs, their reasons, the metrics of the last.
    wall_s, cpu_s : float
        Duration of the computation, without reading, writing and compiling.
    """

    name: str
    ports: tuple[Port, ...] | tuple[OutputPort, ...]
    outputs: dict[str, list[Emitted]] = field(default_factory=dict)
    quality: Quality = field(default_factory=Quality)
    wall_s: float = 0.0
    cpu_s: float = 0.0


def execute(
    name: str, files: Mapping[str, str], config: Mapping[str, Any], implementation: str | None = None
) -> Result:
    """Configure, read the inputs, compute.

    Raises
    ------
    ConfigurationError
        If a name, implementation or parameter is unknown.
    InputError
        If an input is unusable. A refusal by the algorithm is a FAILED result, not an error.
    """
    registry = Registry.default()
    kind, folder = registry.resolve(name)
    if kind == "dfpc":
        return _run_dfpc(folder, files, dict(config), implementation)
    return _run_dfn(
        folder, files, dict(config), implementation or registry.dfn(folder).implementation_aliases.get(name)
    )


def _run_dfn(
    folder: str, files: Mapping[str, str], config: dict[str, Any], implementation: str | None
) -> Result:
    registry = Registry.default()
    description = registry.dfn(folder)
    node = registry.make_dfn(folder, implementation)
    node.configure(config)
    interface = importlib.import_module(f"{registry.dfns[folder].package}.{folder}.interface")
    inputs = getattr(interface, f"{description.name}Inputs")(**read_inputs(description.input_ports, files))
    result = Result(folder, description.output_ports)
    with _measured(result):
        outputs = node.process(inputs)
    if result.quality.status is Status.FAILED:
        return result
    result.outputs = {p.attribute: [Emitted(getattr(outputs, p.attribute))] for p in description.output_ports}
    status = Status.DEGRADED if node.reasons else Status.OK
    result.quality = Quality(status, node.reasons, metrics=dict(node.metrics))
    return result


def _run_dfpc(
    folder: str, files: Mapping[str, str], config: dict[str, Any], implementation: str | None
) -> Result:
    dfpc = Registry.default().make_dfpc(folder)
    dfpc.configure(config, DfpcContext(robot=ROBOT), implementation)
    values = read_inputs(dfpc.description.input_ports, files)
    stamp_ns = max((int(getattr(v, "stamp_ns", 0)) for v in values.values()), default=0)
    result = Result(folder, dfpc.description.output_ports)
    emitted: list[Output] = []
    with _measured(result):
        for port in sorted(values):
            frame, child = _frames(values[port])
            sample = Sample(port, stamp_ns, 0, values[port], id="", frame=frame, child=child)
            emitted += dfpc.step(sample)
        emitted += dfpc.finish()
        if not emitted:
            raise RefusedError(f"{folder}: no output", ("no_output",))
    if result.quality.status is Status.FAILED:
        return result
    for output in emitted:
        kept = Emitted(output.value, output.quality.covariance_kind)
        result.outputs.setdefault(output.port, []).append(kept)
    result.quality = _joined([output.quality for output in emitted])
    return result


def _frames(value: Any) -> tuple[str, str]:
    """Frame and child as a sample's header would say them."""
    parent = getattr(value, "parent_frame", None)
    if parent is not None:
        return str(parent), str(value.child_frame)
    try:
        return str(getattr(value, "frame", "")), ""
    except CdffError:
        return "", ""


def _joined(qualities: list[Quality]) -> Quality:
    reasons = tuple(dict.fromkeys(reason for q in qualities for reason in q.reasons))
    last = qualities[-1]
    return Quality(worst(*(q.status for q in qualities)), reasons, last.covariance_kind, last.metrics)


@contextmanager
def _measured(result: Result) -> Iterator[None]:
    """Put the time spent inside, and a refusal, into the result."""
    start_s, cpu_start_s = time.perf_counter(), time.process_time()
    try:
        yield
    except RefusedError as error:
        result.quality = Quality(Status.FAILED, error.reasons or (str(error),))
    finally:
        result.wall_s = time.perf_counter() - start_s
        result.cpu_s = time.process_time() - cpu_start_s
