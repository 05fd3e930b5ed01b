# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of which each sample can be read by its number: folders of files, and files with an index."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.product import Header
from cdff_dev.logs.source import (
    LogSample,
    LogSource,
    StreamInfo,
    Unconverted,
    chosen_streams,
    recorded_header,
)


@dataclass(frozen=True, slots=True, eq=False)
class IndexedStream:
    """A stream whose samples are read by number.

    Attributes
    ----------
    type_name : str
        ASN.1 type of the samples.
    stamps_ns : array, shape (n,), int64
        Stamps in the order of writing, multiples of 1000.
    read : callable
        Returns the value of sample ``i``.
    header : callable, optional
        Returns the header of sample ``i``, or None.
    """

    type_name: str
    stamps_ns: NDArray[np.int64]
    read: Callable[[int], Any]
    header: Callable[[int], Header | None] = lambda _: None

    @property
    def info(self) -> StreamInfo:
        """Type, number and times of the samples."""
        n = len(self.stamps_ns)
        times = (int(self.stamps_ns.min()), int(self.stamps_ns.max())) if n else (0, 0)
        return StreamInfo(self.type_name, n, *times)


class IndexedLog(LogSource):
    """A log as a ``LogSource``, made of streams whose samples are read when they are yielded."""

    def __init__(
        self, streams: Mapping[str, IndexedStream], unconverted: Mapping[str, Unconverted] | None = None
    ) -> None:
        self._indexed = dict(sorted(streams.items()))
        self._unconverted = dict(unconverted or {})

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content without a stream, by its name in the log."""
        return self._unconverted

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name, in order."""
        return {name: stream.info for name, stream in self._indexed.items()}

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq).

        Raises
        ------
        InputError
            If a stream is not in the log.
        CodecError
            If a sample cannot be read.
        """
        return self.samples_from(np.iinfo(np.int64).min, streams)

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples from a stamp on, in the order of ``samples``; earlier ones are not read."""
        names = chosen_streams(self._indexed, streams)
        chosen = [self._indexed[name] for name in names]
        counts = [len(stream.stamps_ns) for stream in chosen]
        rank = np.repeat(np.arange(len(chosen)), counts)
        seq = np.concatenate([np.arange(0), *(np.arange(n) for n in counts)])
        stamps_ns = np.concatenate([np.arange(0), *(stream.stamps_ns for stream in chosen)])
        order = np.lexsort((seq, rank, stamps_ns))
        for i in order[np.searchsorted(stamps_ns[order], stamp_ns) :]:
            stream, number = chosen[rank[i]], int(seq[i])
            yield LogSample(
                names[rank[i]],
                stream.type_name,
                int(stamps_ns[i]),
                number,
                stream.read(number),
                stream.header(number),
            )

    def stamps_ns(self, stream: str) -> NDArray[np.int64]:
        """Return the stamps of a stream in the order of writing."""
        return self._indexed[stream].stamps_ns

    def close(self) -> None:
        """Close the files, if any are open."""


def headers(
    name: str, stamps_ns: NDArray[np.int64], *, frame: str = "", child: str | None = None, producer: str = ""
) -> Callable[[int], Header]:
    """Return the headers of a stream whose samples were recorded without, by number."""

    def header(number: int) -> Header:
        stamp_ns = int(stamps_ns[number])
        return recorded_header(name, number, stamp_ns, frame=frame, child=child, producer=producer)

    return header
