# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run of one DFN or DFPC on input files."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from cdff_common.errors import CdffError, RefusedError
from cdff_common.interfaces.description import OutputPort, Port
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status, worst
from cdff_common.interfaces.registry import Registry
from cdff_dev.compilation import compilation_notice
from cdff_dev.run.inputs import ROBOT, read_inputs, read_sequence


@dataclass(frozen=True, slots=True, eq=False)
class PortValue:
    """A value of an output port; None if the DFPC refused it."""

    value: Any
    covariance_kind: CovarianceKind = CovarianceKind.NONE


@dataclass(slots=True)
class Result:
    """Outputs, quality and duration of a run.

    Attributes
    ----------
    name : str
        Folder of the DFN or DFPC.
    ports : tuple of Port
        Output ports.
    outputs : dict of str to list of PortValue
        Values by port, in the order of output.
    quality : Quality
        Worst status and all reasons of the outputs, metrics of the last output.
    wall_s, cpu_s : float
        Duration of the computation, without reading, writing and compiling.
    """

    name: str
    ports: tuple[Port, ...] | tuple[OutputPort, ...]
    outputs: dict[str, list[PortValue]] = field(default_factory=dict)
    quality: Quality = field(default_factory=Quality)
    wall_s: float = 0.0
    cpu_s: float = 0.0


def execute(
    name: str,
    files: Mapping[str, str | Sequence[str]],
    config: Mapping[str, Any],
    implementation: str | None = None,
) -> Result:
    """Configure a DFN or DFPC, read its inputs, and compute.

    Raises
    ------
    ConfigurationError
        If a name, implementation or parameter is unknown.
    InputError
        If an input cannot be used. If the algorithm refuses, no error is raised: the result is FAILED.
    """
    registry = Registry.default()
    kind, folder = registry.resolve(name)
    if kind == "dfpc":
        return _run_dfpc(folder, files, dict(config), implementation)
    return _run_dfn(
        folder, files, dict(config), implementation or registry.dfn(folder).implementation_aliases.get(name)
    )


def _run_dfn(
    folder: str, files: Mapping[str, str | Sequence[str]], config: dict[str, Any], implementation: str | None
) -> Result:
    """Run a DFN once with inputs from files, and return its outputs."""
    registry = Registry.default()
    description = registry.dfn(folder)
    node = registry.make_dfn(folder, implementation)
    with compilation_notice(folder):
        node.configure(config)
    interface = importlib.import_module(f"{registry.dfns[folder].package}.{folder}.interface")
    inputs = getattr(interface, f"{description.name}Inputs")(**read_inputs(description.input_ports, files))
    result = Result(folder, description.output_ports)
    with _measure_duration(result):
        outputs = node.process(inputs)
    if result.quality.status is Status.FAILED:
        return result
    result.outputs = {
        p.attribute: [PortValue(getattr(outputs, p.attribute))] for p in description.output_ports
    }
    status = Status.DEGRADED if node.reasons else Status.OK
    result.quality = Quality(status, node.reasons, metrics=dict(node.metrics))
    return result


def _run_dfpc(
    folder: str, files: Mapping[str, str | Sequence[str]], config: dict[str, Any], implementation: str | None
) -> Result:
    """Run a DFPC with inputs from files, and return its outputs."""
    dfpc = Registry.default().make_dfpc(folder)
    with compilation_notice(folder):
        dfpc.configure(config, DfpcContext(robot=ROBOT), implementation)
    batches = read_sequence(dfpc.description.input_ports, files)
    result = Result(folder, dfpc.description.output_ports)
    outputs: list[Output] = []
    with _measure_duration(result):
        for seq, values in enumerate(batches):
            for sample in _samples(values, seq):
                outputs += dfpc.step(sample)
        outputs += dfpc.finish()
        if not outputs:
            raise RefusedError(f"{folder}: no output", ("no_output",))
    if result.quality.status is Status.FAILED:
        return result
    for output in outputs:
        port_value = PortValue(output.value, output.quality.covariance_kind)
        result.outputs.setdefault(output.port, []).append(port_value)
    result.quality = _merged_quality([output.quality for output in outputs])
    return result


def _samples(values: Mapping[str, Any], seq: int) -> Iterator[Sample]:
    """Yield the values of one time as samples, lists (of models) first, so that all models are known before
    the data arrive.
    """
    queue = [(port, v) for port in sorted(values) if isinstance(values[port], list) for v in values[port]]
    queue += [(port, values[port]) for port in sorted(values) if not isinstance(values[port], list)]
    stamp_ns = max((int(getattr(v, "stamp_ns", 0)) for _, v in queue), default=0)
    for port, value in queue:
        frame, child = _frames(value)
        yield Sample(port, stamp_ns, seq, value, id="", frame=frame, child=child)


def _frames(value: Any) -> tuple[str, str]:
    """Return the frame and the child frame of a value; empty where it has none."""
    parent = getattr(value, "parent_frame", None)
    if parent is not None:
        return str(parent), str(value.child_frame)
    try:
        return str(getattr(value, "frame", "")), ""
    except CdffError:
        return "", ""


def _merged_quality(qualities: list[Quality]) -> Quality:
    reasons = tuple(dict.fromkeys(reason for q in qualities for reason in q.reasons))
    last = qualities[-1]
    return Quality(worst(*(q.status for q in qualities)), reasons, last.covariance_kind, last.metrics)


@contextmanager
def _measure_duration(result: Result) -> Iterator[None]:
    """Store the duration of the block in the result; a RefusedError in it makes the result FAILED."""
    start_s, cpu_start_s = time.perf_counter(), time.process_time()
    try:
        yield
    except RefusedError as error:
        result.quality = Quality(Status.FAILED, error.reasons or (str(error),))
    finally:
        result.wall_s = time.perf_counter() - start_s
        result.cpu_s = time.process_time() - cpu_start_s
