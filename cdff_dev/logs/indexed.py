# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs of which each sample can be read by its number: folders of files, and files with an index."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError
from cdff_common.interfaces.product import Header
from cdff_dev.logs.source import (
    LogSample,
    LogSource,
    StreamInfo,
    Unconverted,
    chosen_streams,
    recorded_header,
)

logger = logging.getLogger(__name__)

#: Largest number of damaged samples of a log for which a warning is logged; all are listed in
#: ``unconverted``.
_MAX_LOGGED = 5


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
    """A log as a ``LogSource``, made of streams whose samples are read when they are yielded.

    Attributes
    ----------
    skips_damaged : bool
        Whether a sample that cannot be read is left out, logged and listed in ``unconverted``, as in folders
        with a file for each sample. If none can be read, the first error is raised.
    """

    skips_damaged = True

    def __init__(
        self, streams: Mapping[str, IndexedStream], unconverted: Mapping[str, Unconverted] | None = None
    ) -> None:
        self._indexed = dict(sorted(streams.items()))
        self._unconverted = dict(unconverted or {})
        self._damaged: dict[tuple[str, int], str] = {}

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content without a stream, by its name in the log; with the damaged samples found so far."""
        damaged_streams: dict[str, Unconverted] = {}
        for (name, _), reason in self._damaged.items():
            count = damaged_streams[name].count if name in damaged_streams else 0
            damaged_streams[name] = Unconverted(
                "damaged sample", count + 1, damaged_streams[name].reason if count else reason
            )
        return self._unconverted | {
            f"{name}: damaged samples": item for name, item in damaged_streams.items()
        }

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
            If a sample cannot be read; with ``skips_damaged`` if none can be.
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
        fault, has_sample = None, False
        for i in order[np.searchsorted(stamps_ns[order], stamp_ns) :]:
            name, stream, number = names[rank[i]], chosen[rank[i]], int(seq[i])
            try:
                value = stream.read(number)
            except CodecError as error:
                if not self.skips_damaged or len(order) == 1:
                    raise
                fault = fault or error
                self._report_damaged(name, number, str(error))
                continue
            has_sample = True
            yield LogSample(name, stream.type_name, int(stamps_ns[i]), number, value, stream.header(number))
        if fault is not None and not has_sample:
            raise fault

    def _report_damaged(self, name: str, number: int, reason: str) -> None:
        if (name, number) not in self._damaged:
            self._damaged[name, number] = reason
            if len(self._damaged) <= _MAX_LOGGED:
                logger.warning("%s; sample %d of %s is left out", reason, number, name)

    def stamps_ns(self, stream: str) -> NDArray[np.int64]:
        """Return the stamps of a stream in the order of writing."""
        return self._indexed[stream].stamps_ns

    def close(self) -> None:
        """Close the files, if any are open."""


def headers(
    name: str, stamps_ns: NDArray[np.int64], *, frame: str = "", child: str | None = None, producer: str = ""
) -> Callable[[int], Header]:
    """Return headers for a stream whose samples were recorded without headers, by number of the sample."""

    def header(number: int) -> Header:
        stamp_ns = int(stamps_ns[number])
        return recorded_header(name, number, stamp_ns, frame=frame, child=child, producer=producer)

    return header
