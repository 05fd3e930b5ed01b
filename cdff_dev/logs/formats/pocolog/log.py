# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of ROCK: each port whose type has a conversion becomes a stream."""

from __future__ import annotations

import logging
import re
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from cdff_common.contract.foreign_names import name_of
from cdff_common.errors import CodecError
from cdff_dev.logs.byte_files import LogFiles
from cdff_dev.logs.formats.pocolog.blocks import FileBlocks, read_blocks
from cdff_dev.logs.formats.pocolog.choice import Choice, choose
from cdff_dev.logs.formats.pocolog.ports import Port, PortPart
from cdff_dev.logs.formats.pocolog.registry import Registry
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.source import Unconverted
from services.rock_types.values import ROBOT

_log = logging.getLogger(__name__)
_NUMBERED = re.compile(r"(.+)\.(\d{1,9})")


@dataclass(slots=True)
class _PortFiles:
    """A port and its samples in the files of one recording, which has their path without the number."""

    recording: Path
    name: str
    type_name: str
    parts: list[PortPart] = field(default_factory=list)

    @property
    def task_and_port(self) -> tuple[str, str]:
        """Names of task and port: ``/camera.frame`` is ``camera`` and ``frame``."""
        task, _, port = self.name.strip("/").rpartition(".")
        return name_of(task or port, "task"), name_of(port if task else "data", "port")


class _ChosenPort(NamedTuple):
    """A port, its conversions, and the fields without one by their names in ``unconverted``.

    A port without a conversion has its own name there, and an empty name of a field.
    """

    port: _PortFiles
    choice: Choice
    lost: dict[str, str]


class PocologLog(IndexedLog):
    """Log files of ROCK as a ``LogSource``.

    Files ``NAME.0.log``, ``NAME.1.log`` are one recording. The stream of port ``frame`` of task ``camera`` is
    ``/robot/camera.frame``; if several ports of the log have this name, ``/robot/NAME_camera.frame``. Stamps
    are those of the samples' own field ``time``, if they have one that is set, else logical times.

    Opening a log reads the headers of all blocks and the times of the samples that are converted, which needs
    about 70 bytes of memory per sample. The content of damaged files before the damage is read; the damage is
    listed in ``unconverted`` and logged. Ports and fields without a conversion are decoded in ``others``.

    Parameters
    ----------
    files : list of Path

    Raises
    ------
    CodecError
        If a file is not a pocolog file of version 2.
    """

    skips_damaged = False

    def __init__(self, files: list[Path]) -> None:
        self.files = sorted(files, key=_recording)
        self._reader = LogFiles(self.files)
        unconverted: dict[str, Unconverted] = {}
        ports = _ports([read_blocks(path) for path in self.files], unconverted)
        chosen = _chosen_ports(ports, unconverted)
        super().__init__(self._converted_streams(chosen), unconverted)
        self._ports = chosen

    @cached_property
    def others(self) -> IndexedLog:
        """Ports and fields without a conversion, decoded; they are indexed at the first access."""
        streams: dict[str, IndexedStream] = {}
        for port, choice, reason_by_field in self._ports:
            if reason_by_field:
                samples = Port(self.files, self._reader, port.parts, is_split=choice.is_split)
                streams |= {
                    name: samples.plain_stream(port.type_name, key) for name, key in reason_by_field.items()
                }
        return _OtherPorts(streams)

    def _converted_streams(self, ports: list[_ChosenPort]) -> dict[str, IndexedStream]:
        """Return the streams of the ports that are converted, by name."""
        streams: dict[str, IndexedStream] = {}
        tasks = Counter(port.task_and_port for port, choice, _ in ports if choice.conversions)
        for port, choice, _ in ports:
            if not choice.conversions:
                continue
            samples = Port(self.files, self._reader, port.parts, is_split=choice.is_split)
            task, name = port.task_and_port
            if tasks[task, name] > 1:
                task = name_of(f"{port.recording.name}_{task}", "task")
            for conversion in choice.conversions:
                stream = _free(f"/{ROBOT}/{task}.{name}{conversion.suffix}", streams)
                streams[stream] = samples.stream(stream, task, conversion)
        return streams

    def close(self) -> None:
        """Close the files."""
        self._reader.close()


class _OtherPorts(IndexedLog):
    """Ports and fields without a conversion; a damaged sample ends the reading, as in ``PocologLog``."""

    skips_damaged = False


def _recording(path: Path) -> tuple[Path, int]:
    """Return path of the recording and number of a file: ``camera.0.log`` is file 0 of ``camera``."""
    match = _NUMBERED.fullmatch(path.stem)
    return (path.with_name(match[1]), int(match[2])) if match else (path.with_suffix(""), 0)


def _free(name: str, used_names: dict[str, IndexedStream] | dict[str, Unconverted]) -> str:
    """Return a name, with a number if it is taken."""
    numbered, n = name, 1
    while numbered in used_names:
        n += 1
        numbered = f"{name}_{n}"
    return numbered


def _ports(files: list[FileBlocks], unconverted: dict[str, Unconverted]) -> list[_PortFiles]:
    """Return the ports whose types are readable, and list other content of the files in ``unconverted``."""
    ports: dict[tuple[Path, str, str], _PortFiles] = {}
    registries: dict[tuple[bytes, str], Registry] = {}
    for number, file_blocks in enumerate(files):
        for blocks in file_blocks.streams:
            try:
                definitions = blocks.registry, file_blocks.order
                if definitions not in registries:
                    registries[definitions] = Registry(*definitions)
                kind = registries[definitions].build(blocks.type_name)
            except CodecError as error:
                name = _free(f"{file_blocks.path.name}: {blocks.name}", unconverted)
                unconverted[name] = Unconverted(blocks.type_name, len(blocks.starts), str(error))
                continue
            key = (_recording(file_blocks.path)[0], blocks.name, blocks.type_name)
            ports.setdefault(key, _PortFiles(*key)).parts.append(
                PortPart(number, file_blocks.order, kind, blocks)
            )
        _list_remainder(file_blocks, unconverted)
    return list(ports.values())


def _chosen_ports(ports: list[_PortFiles], unconverted: dict[str, Unconverted]) -> list[_ChosenPort]:
    """Return the ports with their conversions, and list those and fields without one in ``unconverted``."""
    names = Counter(port.name for port in ports)
    chosen = []
    for port in ports:
        label = port.name if names[port.name] == 1 else f"{port.recording.name}: {port.name}"
        count = sum(len(part.blocks.starts) for part in port.parts)
        choice = choose(port.type_name, [part.kind for part in port.parts])
        reasons = {f"{label}: field {name}": (name, reason) for name, reason in choice.lost.items()}
        if not choice.conversions:
            reasons = {label: ("", choice.reason)}
        reason_by_field: dict[str, str] = {}
        for wanted_name, (field_name, reason) in reasons.items():
            name = _free(wanted_name, unconverted)
            unconverted[name] = Unconverted(port.type_name, count, reason)
            reason_by_field[name] = field_name
        chosen.append(_ChosenPort(port, choice, reason_by_field))
    return chosen


def _list_remainder(file_blocks: FileBlocks, unconverted: dict[str, Unconverted]) -> None:
    """Add damage, undeclared streams and control streams of a file to the content not converted."""
    name = file_blocks.path.name
    if file_blocks.damage:
        _log.warning("%s: %s", file_blocks.path, file_blocks.damage)
        unconverted[_free(name, unconverted)] = Unconverted("damaged block", 0, file_blocks.damage)
    if file_blocks.undeclared:
        unconverted[f"{name}: streams without declaration"] = Unconverted(
            "unknown", file_blocks.undeclared, "their declaration, expected before their samples, is missing"
        )
    if file_blocks.control:
        unconverted[f"{name}: control streams"] = Unconverted(
            "control block", file_blocks.control, "pocolog defines no content for them"
        )
