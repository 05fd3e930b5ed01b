# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay LOG --requests FILE``: reached by entry point, since the toolkit imports no services."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from cdff_common.interfaces.product import Product
from cdff_common.interfaces.profile import Profile
from dpm_store import open_store
from services.rehearsal.mission import LogClock, Recorded, Rehearsal
from services.rehearsal.report import write_answers
from services.rehearsal.script import read_script
from services.rehearsal.sensors import Gate


def rehearse(
    profile: Profile,
    samples: Iterable[tuple[str, str, Any]],
    start_ns: int,
    requests: Path,
    gate: Gate,
    on_product: Callable[[Product], None],
    out: Path,
    store: Path | None,
) -> dict[str, Any]:
    """Run a mission on recorded samples.

    Parameters
    ----------
    profile : Profile
    samples : iterable of (str, str, Sample)
        Robot, source as wiring (``sensor/lidar/scan``) and sample, in the order of their stamps.
    start_ns : int
        Stamp of the first.
    requests : Path
        Script of what is asked for, and when.
    gate : Gate
        Lets samples through as the sensors' modes say.
    on_product : callable
        Told of everything that is made.
    out : Path
        Folder for ``answers.json``, ``answers/`` and ``journal.jsonl``.
    store : Path or None
        Directory of the DPM to store into; None uses one that is thrown away.

    Returns
    -------
    dict
        ``answers`` and counters.

    Raises
    ------
    CdffError
        If the script is malformed, or the store or the folder cannot be used.
    """
    script = read_script(requests, start_ns, profile.robot_ids)
    journal = out / "journal.jsonl"
    journal.unlink(missing_ok=True)
    with ExitStack() as stack:
        directory = store or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="cdff-replay-")))

        def opened(clock: LogClock) -> Any:
            return stack.enter_context(open_store(f"sqlite:///{directory}", clock))

        rehearsal = Rehearsal(profile, start_ns, opened, journal, gate, on_product)
        answers = rehearsal.run((Recorded(*recorded) for recorded in samples), script)
        told = write_answers(out, answers, start_ns)
        products = rehearsal.store.statistics().products
    return {
        "answers": told,
        "samples": rehearsal.delivered,
        "gated": rehearsal.gated,
        "dfpcs": {f"{robot}/{name}": dfpc.totals for (robot, name), dfpc in rehearsal.dfpcs.items()},
        "stored": sum(products.values()),
    }
