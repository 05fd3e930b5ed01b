# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Several logs with different streams as one."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_dev.logs.source import LogSample, LogSource, StreamInfo, Unconverted, chosen_streams


class JoinedLog(LogSource):
    """Several logs as one ``LogSource``, which closes them.

    Parameters
    ----------
    parts : mapping of str to LogSource
        Logs by the names with which their content without a stream is listed.
    unconverted : mapping of str to Unconverted, optional
        Content of none of the logs.

    Raises
    ------
    InputError
        If two logs have a stream of the same name.
    """

    def __init__(
        self, parts: Mapping[str, LogSource], unconverted: Mapping[str, Unconverted] | None = None
    ) -> None:
        self._parts, self._unconverted = dict(parts), dict(unconverted or {})
        self._owners: dict[str, str] = {}
        for name, log in self._parts.items():
            for stream in log.streams:
                if (other := self._owners.setdefault(stream, name)) != name:
                    raise InputError(
                        f"stream {stream} is in {other} and in {name}; expected it once: name one file"
                    )

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams of all logs by name, in order."""
        return {name: self._parts[part].streams[name] for name, part in sorted(self._owners.items())}

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content without a stream: that of a log has its name and a colon before its own."""
        of_parts = {
            f"{part}: {name}": item
            for part, log in self._parts.items()
            for name, item in log.unconverted.items()
        }
        return of_parts | self._unconverted

    @property
    def others(self) -> LogSource | None:
        """Content without a stream that is decoded, of all logs."""
        others_by_part = {
            part: others for part, log in self._parts.items() if (others := log.others) is not None
        }
        return JoinedLog(others_by_part) if others_by_part else None

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq).

        Raises
        ------
        InputError
            If a stream is in no log.
        """
        return self._merge_samples(streams, lambda log, names: log.samples(names))

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples from a stamp on, in the order of ``samples``."""
        return self._merge_samples(streams, lambda log, names: log.samples_from(stamp_ns, names))

    def first_samples(self, streams: Collection[str] | None = None) -> dict[str, LogSample]:
        """Return the first sample of all or some streams."""
        sample_by_stream: dict[str, LogSample] = {}
        for part, names in self._by_part(streams).items():
            sample_by_stream |= self._parts[part].first_samples(names)
        return dict(sorted(sample_by_stream.items()))

    def stamps_ns(self, stream: str) -> NDArray[np.int64]:
        """Return the stamps of a stream in the order of writing."""
        return self._parts[self._owners[stream]].stamps_ns(stream)

    def close(self) -> None:
        """Close all logs."""
        for log in self._parts.values():
            log.close()

    def _merge_samples(
        self,
        streams: Collection[str] | None,
        samples_of: Callable[[LogSource, Sequence[str]], Iterator[LogSample]],
    ) -> Iterator[LogSample]:
        chosen = [samples_of(self._parts[part], names) for part, names in self._by_part(streams).items()]
        return heapq.merge(*chosen, key=lambda s: (s.stamp_ns, s.stream, s.seq))

    def _by_part(self, streams: Collection[str] | None) -> dict[str, list[str]]:
        """Return the chosen streams of each log that has some."""
        streams_by_part: dict[str, list[str]] = {}
        for name in chosen_streams(self._owners, streams):
            streams_by_part.setdefault(self._owners[name], []).append(name)
        return streams_by_part
