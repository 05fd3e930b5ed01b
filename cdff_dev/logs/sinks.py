# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface of the writers of logs, and the choice of one by the name of the log."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self

from cdff_common.errors import InputError

if TYPE_CHECKING:
    from cdff_common.interfaces.product import Header
    from cdff_dev.logs.mapping import LogMap
    from cdff_dev.logs.source import LogSource

#: Stream and loss: a field that the log cannot hold, or the reason why a sample was not written.
Loss = tuple[str, str]
#: Stream, type of its messages, and why it is not the usual one for the format.
Substitute = tuple[str, str, str]
#: Schemas of the messages of an MCAP file: of ROS 2, and of Foxglove in protobuf or JSON.
ROS2, FOXGLOVE, FOXGLOVE_JSON = "ros2", "foxglove", "foxglove-json"
SCHEMAS = (ROS2, FOXGLOVE, FOXGLOVE_JSON)


class LogSink(Protocol):
    """A log that is being written; a context manager that closes it, or removes it after an error."""

    @property
    def losses(self) -> Mapping[Loss, int]:
        """Number of samples of each loss."""
        return {}

    @property
    def substitutes(self) -> Mapping[Substitute, int]:
        """Number of samples of each stream whose messages most programs do not read."""
        return {}

    def write(self, stream: str, value: Any, stamp_ns: int, header: Header | None = None) -> None:
        """Append a sample; raises InputError, or StorageError if it cannot be written."""

    def close(self) -> None:
        """Write the remainder and close the log; raises StorageError."""

    def keep(self) -> None:
        """Keep the samples of a log that could not be closed, under its name."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def create_log(path: Path, mapping: LogMap, *, is_whole: bool = False, schemas: str = ROS2) -> LogSink:
    """Return the writer of a new log.

    Parameters
    ----------
    path : Path
        ``NAME.msg`` for InFuse, ``NAME.bag`` for ROS 1, ``NAME.mcap`` for MCAP, a name without suffix for the
        folder of a ROS 2 bag (sqlite3). A file of that name is replaced.
    mapping : LogMap
        Names in the new log.
    is_whole : bool
        Remove an incomplete ``.msg`` after an error instead of keeping its samples, as the others do.
    schemas : str
        One of ``SCHEMAS``; those of Foxglove are only for an MCAP file.

    Raises
    ------
    InputError
        If no writer has this suffix or these schemas, or the folder exists.
    StorageError
        If it cannot be written.
    """
    suffix = path.suffix.lower()
    if schemas != ROS2 and suffix != ".mcap":
        raise InputError(f"log {path}: Foxglove's schemas are written to MCAP files; expected NAME.mcap")
    if suffix == ".msg":
        from cdff_dev.logs.formats.infuse.writer import LogWriter

        return LogWriter(path, is_whole=is_whole)
    if suffix not in (".bag", ".mcap", ""):
        raise InputError(
            f"log {path}: no writer for {suffix}; expected .msg, .bag, .mcap, or a folder for a ROS 2 bag"
        )
    from cdff_dev.logs.formats.ros.writer import create_ros_log

    return create_ros_log(path, mapping, schemas=schemas)


def refuse_own_input(log: LogSource, path: Path) -> None:
    """Raise InputError if the log at ``path`` would replace a file of the log that is read."""
    from cdff_dev.logs.formats.infuse.writer import chunk_files

    target = path.resolve()
    replaced = {target, *chunk_files(target.parent, target.stem)}
    for file in getattr(log, "files", []):
        source = Path(file).resolve()
        if source in replaced or source.parent == target:
            raise InputError(f"{path}: would replace the log that is read; name another")
