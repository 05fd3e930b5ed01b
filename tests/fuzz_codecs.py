# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Feed mutated messages of every type to every decoder.

``python -m tests.fuzz_codecs --messages 1000000 [--out FILE]``

A decoder must return a message or raise CodecError. Anything else is a finding: another exception, a
decoding that takes longer than ``HANG_S``, or memory growth of more than ``MEMORY_MB`` since the start.
Equal seeds give equal messages, so that a finding can be reproduced; ``--first`` is the number of the first
message, so that a long run can be divided.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from cdff_common.codecs import CODECS, decode, encode
from cdff_common.errors import CodecError
from tests.support.messages import ALL, long_message, random_message

HANG_S = 5.0
MEMORY_MB = 1024
#: Valid messages per type and codec from which the mutations are made.
_SEEDS = 6
#: Octets with a meaning in one of the encodings: length, fragment, tag, special REAL, MessagePack type.
_SPECIAL_OCTETS = (
    0x00,
    0x01,
    0x03,
    0x40,
    0x42,
    0x7F,
    0x80,
    0x83,
    0x84,
    0x8F,
    0x9F,
    0xBF,
    0xC0,
    0xC1,
    0xC4,
    0xC6,
    0xDB,
    0xDC,
    0xDD,
    0xDF,
    0xFF,
    ord("<"),
    ord(">"),
    ord("/"),
    ord("&"),
)

Mutation = Callable[[bytearray, np.random.Generator], bytearray]


def _flip(data: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(int(rng.integers(1, 5))):
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return data


def _replace(data: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(int(rng.integers(1, 5))):
        data[int(rng.integers(len(data)))] = int(rng.choice(_SPECIAL_OCTETS))
    return data


def _cut(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: int(rng.integers(len(data)))]


def _remove(data: bytearray, rng: np.random.Generator) -> bytearray:
    at = int(rng.integers(len(data)))
    del data[at : at + int(rng.integers(1, 9))]
    return data


def _insert(data: bytearray, rng: np.random.Generator) -> bytearray:
    at = int(rng.integers(len(data) + 1))
    data[at:at] = rng.integers(0, 256, int(rng.integers(1, 9)), dtype=np.uint8).tobytes()
    return data


def _repeat(data: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(data)))
    section = data[start : start + int(rng.integers(1, 33))]
    data[start:start] = section * int(rng.integers(1, 9))
    return data


def _noise(data: bytearray, rng: np.random.Generator) -> bytearray:
    at = int(rng.integers(len(data)))
    return data[:at] + bytearray(rng.integers(0, 256, int(rng.integers(1, 65)), dtype=np.uint8).tobytes())


MUTATIONS: tuple[Mutation, ...] = (_flip, _replace, _cut, _remove, _insert, _repeat, _noise)


@dataclass(slots=True)
class Findings:
    """Counts and findings of a run."""

    decoded: int = 0
    refused: int = 0
    findings: list[dict[str, Any]] = field(default_factory=list)
    by_codec: Counter[str] = field(default_factory=Counter)
    longest_s: float = 0.0


class _Hang(BaseException):
    """A decoding took too long; no ``except Exception`` hides it."""


def _on_alarm(signum: int, frame: FrameType | None) -> None:
    raise _Hang


def mutated(first: int, count: int, seed: int) -> Iterator[tuple[int, str, str, bytes]]:
    """``(number, type, codec, octets)`` of messages ``first`` to ``first + count``; every type
    and codec in turn.
    """
    corpus: dict[tuple[str, str], list[bytes]] = {}
    pairs = [(name, codec) for name in ALL for codec in CODECS]
    for number in range(first, first + count):
        name, codec = pairs[number % len(pairs)]
        if (name, codec) not in corpus:
            rng = np.random.default_rng([seed, ALL.index(name)])
            values = [random_message(name, rng) for _ in range(_SEEDS - 1)]
            corpus[name, codec] = [encode(v, codec, name) for v in (*values, long_message(name, rng))]
        rng = np.random.default_rng([seed, number])
        seeds = corpus[name, codec]
        data = bytearray(seeds[int(rng.integers(len(seeds)))])
        for _ in range(int(rng.choice((1, 1, 1, 2, 3)))):
            if data:
                data = MUTATIONS[int(rng.integers(len(MUTATIONS)))](data, rng)
        yield number, name, codec, bytes(data)


def fuzz(messages: int, *, seed: int = 0, first: int = 0, cpu_s: float = float("inf")) -> Findings:
    """Decode ``messages`` mutated messages, or fewer if ``cpu_s`` of CPU time is used up."""
    out = Findings()
    begin_rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    previous = signal.signal(signal.SIGALRM, _on_alarm)
    begin_s = time.process_time()
    try:
        for number, name, codec, data in mutated(first, messages, seed):
            if time.process_time() - begin_s > cpu_s:
                break
            out.by_codec[codec] += 1
            problem = _decode(name, codec, data, out)
            rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            if rss - begin_rss > MEMORY_MB << 10:
                problem, begin_rss = f"memory grew to {rss >> 10} MB", rss
            if problem:
                finding = {
                    "number": number,
                    "type": name,
                    "codec": codec,
                    "problem": problem,
                    "octets": data.hex(),
                }
                out.findings.append(finding)
    finally:
        signal.signal(signal.SIGALRM, previous)
    return out


def _decode(name: str, codec: str, data: bytes, out: Findings) -> str:
    """Decode a message; return a description of the fault, or "" if there is none."""
    begin_s = time.process_time()
    signal.setitimer(signal.ITIMER_REAL, 12 * HANG_S)
    try:
        decode(name, data, codec)
        out.decoded += 1
    except CodecError:
        out.refused += 1
    except _Hang:
        return "the decoder hung"
    except Exception as error:  # noqa: BLE001  # any other error is a finding
        return f"{type(error).__name__}: {error}"[:300]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    took_s = time.process_time() - begin_s
    out.longest_s = max(out.longest_s, took_s)
    return f"it took {took_s:.1f} s of CPU time" if took_s > HANG_S else ""


def main(argv: list[str] | None = None) -> int:
    """Fuzz and report the findings; exit 1 if there is one."""
    parser = argparse.ArgumentParser(prog="fuzz_codecs", description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first message")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cpu-s", type=float, default=float("inf"), help="stop after this CPU time")
    parser.add_argument("--out", type=Path, help="write JSON here instead of printing it")
    args = parser.parse_args(argv)
    begin_s = time.process_time()
    result = fuzz(args.messages, seed=args.seed, first=args.first, cpu_s=args.cpu_s)
    report = {
        "what": "mutated messages over all types and codecs: decoded, refused with CodecError, or a finding",
        "seed": args.seed,
        "first": args.first,
        "messages": sum(result.by_codec.values()),
        "types": len(ALL),
        "codecs": dict(result.by_codec),
        "decoded": result.decoded,
        "refused": result.refused,
        "findings": result.findings,
        "longest_decode_cpu_s": round(result.longest_s, 3),
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10,
        "cpu_s": round(time.process_time() - begin_s, 1),
        "python": platform.python_version(),
    }
    text = json.dumps(report, indent=2) + "\n"
    if args.out:
        args.out.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
    return 1 if result.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
