# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Open damaged copies of small recordings in a child process whose memory is limited.

``python -m evaluation.runs.log_mutations FORMAT FIRST LAST STATE DATA`` opens the copies with the numbers
FIRST to LAST - 1, writes the number of the current one to the file STATE, and prints the outcomes as JSON.
"""

from __future__ import annotations

import json
import logging
import resource
import signal
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import CdffError, UnavailableError
from cdff_dev.logs import open_log
from evaluation.scenes.log_files import Files, recordings

#: Memory that a child may allocate beyond that of its libraries, and CPU time for one recording.
MEMORY_BYTES = 1 << 30
CPU_LIMIT_S = 60.0
#: Folder of the copies: in memory, because most of the time is that of the disk otherwise.
_MEMORY_FOLDER = Path("/dev/shm")
_ROOT = Path(__file__).resolve().parents[2]
_PATTERNS = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\0\0\xc0\x7f", b"nan ", b"-1e9")


def run(name: str, first: int, last: int, data: Path | None) -> dict[str, Any]:
    """Open the copies ``first`` to ``last - 1`` of a format; a copy that ends the child is a fault.

    Returns
    -------
    dict
        ``outcomes`` by name, ``faults`` with number and reason, ``memory_mb`` (largest growth of a child).
    """
    outcomes: Counter[str] = Counter()
    faults: list[dict[str, Any]] = []
    memory_mb = 0.0
    while first < last:
        with tempfile.TemporaryDirectory() as folder:
            state = Path(folder) / "state"
            arguments = [name, str(first), str(last), str(state), "" if data is None else str(data)]
            command = [sys.executable, "-m", "evaluation.runs.log_mutations", *arguments]
            completed = subprocess.run(command, cwd=_ROOT, capture_output=True, check=False)
            if not state.is_file():
                reason = _reason(completed.returncode, completed.stderr)
                raise UnavailableError(f"{name}: the child ended before its first copy: {reason}")
            number = int(state.read_text())
        if completed.returncode == 0:
            result = json.loads(completed.stdout.splitlines()[-1])
            outcomes.update(result["outcomes"])
            faults += result["faults"]
            memory_mb = max(memory_mb, result["memory_mb"])
            break
        outcomes.update({"not counted before a crash": number - first})
        reason = _reason(completed.returncode, completed.stderr)
        faults.append({"format": name, "number": number, "reason": reason})
        first = number + 1
    return {"outcomes": dict(outcomes), "faults": faults, "memory_mb": memory_mb}


def _reason(returncode: int, stderr: bytes) -> str:
    if returncode < 0:
        return f"ended by {signal.Signals(-returncode).name}"
    return f"exit code {returncode}: {stderr.decode(errors='replace').strip()[-300:]}"


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a copy with one to three changed, inserted, removed or repeated parts, or without its end."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(data) + 1))
        match rng.integers(7):
            case 0:
                del data[at : at + int(rng.integers(1, 9))]
            case 1:
                data[at:at] = rng.bytes(int(rng.integers(1, 9)))
            case 2 | 3:
                data[at : at + 4] = _PATTERNS[rng.integers(len(_PATTERNS))]
            case 4:
                data[at:at] = data[at : at + int(rng.integers(1, 65))]
            case _:
                data[at : at + 1] = rng.bytes(1)
    return bytes(data[: rng.integers(len(data) + 1)] if rng.random() < 0.1 else data)


def outcome(files: Files, number: int | None, folder: Path) -> str:
    """Damage one file of the recording in a folder, read it, and return how far that was possible.

    The folder is written if it does not exist. Without a number no file is damaged.
    """
    if not folder.is_dir():
        for path, content in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
    if number is None:
        return _read(files, folder)
    rng = np.random.default_rng(number)
    name = sorted(files)[rng.integers(len(files))]
    (folder / name).write_bytes(mutated(files[name], rng))
    try:
        return _read(files, folder)
    finally:
        (folder / name).write_bytes(files[name])


def _read(files: Files, folder: Path) -> str:
    """Read the recording in a folder, and return how far that was possible.

    Raises
    ------
    LookupError
        The error of the reader does not name the file.
    """
    target = folder / next(iter(files)) if len(files) == 1 else folder
    samples = 0
    try:
        with open_log(target) as log:
            for part in (log, log.others):
                for _ in part.samples() if part is not None else ():
                    samples += 1
            is_whole = not any(item.type_name.startswith("damaged") for item in log.unconverted.values())
    except CdffError as error:
        if folder.name not in str(error):
            raise LookupError(f"error without the name of the file: {error}") from error
        return "read up to an error" if samples else "refused"
    return "read" if is_whole else "read without the damaged part"


def _peak_kb() -> int:
    """Return the largest resident memory of this process; that of ``getrusage`` includes its parent's."""
    with Path("/proc/self/status").open(encoding="ascii") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def main(name: str, first: str, last: str, state: str, data: str) -> None:
    """Open the copies and print the outcomes."""
    logging.disable(logging.CRITICAL)
    available = recordings(Path(data) if data else None, name)
    with tempfile.TemporaryDirectory(dir=_MEMORY_FOLDER if _MEMORY_FOLDER.is_dir() else None) as parent:
        recorded = [(known, files) for known, all_files in available.items() for files in all_files]
        chosen = [(*each, Path(parent) / f"recording_{k}") for k, each in enumerate(recorded)]
        for _, files, folder in chosen:
            outcome(files, None, folder)  # import the libraries
        before_kb = _peak_kb()
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY_BYTES, size + MEMORY_BYTES))
        outcomes: Counter[str] = Counter()
        faults = []
        for number in range(int(first), int(last)):
            Path(state).write_text(str(number))
            known, files, folder = chosen[number % len(chosen)]
            signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT_S)
            try:
                outcomes[outcome(files, number, folder)] += 1
            except Exception as error:  # noqa: BLE001  # a fault of the reader, which is recorded
                place = traceback.extract_tb(error.__traceback__)[-1]
                where = f"{Path(place.filename).name}:{place.lineno}"
                faults.append(
                    {
                        "format": known,
                        "number": number,
                        "reason": f"{type(error).__name__} {where}: {error}"[:300],
                    }
                )
    grown_kb = _peak_kb() - before_kb
    sys.stdout.write(json.dumps({"outcomes": outcomes, "faults": faults, "memory_mb": grown_kb / 1024}))


if __name__ == "__main__":
    main(*sys.argv[1:])
