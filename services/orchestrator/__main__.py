# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator as a process.

python -m services.orchestrator --profile FILE [--connect tcp/127.0.0.1:7447] [--data-dir DIR]
"""

from __future__ import annotations

import argparse
import os
import threading

from cdff_common.bus import Bus
from cdff_common.codecs import encode
from cdff_common.interfaces.profile import load_profile
from cdff_common.output import make_folder
from cdff_common.process import cap_threads, data_dir_of, run_service
from cdff_common.types import TransformWithCovariance
from services.orchestrator.leader import Candidate, claim, lock_folder
from services.orchestrator.service import Orchestrator


def main(argv: list[str] | None = None) -> int:
    """Orchestrate until SIGTERM."""
    cap_threads(1)
    parser = argparse.ArgumentParser(prog="orchestrator", description=__doc__)
    parser.add_argument("--profile", default=os.environ.get("CDFF_PROFILE"), required="CDFF_PROFILE" not in os.environ)
    parser.add_argument("--connect", default=None)
    parser.add_argument("--data-dir", help="CDFF_DATA_DIR, ~/.local/share/cdff")
    parser.add_argument("--capacity", type=int, default=64, help="most requests open at a time")
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        encode(
            TransformWithCovariance(), "uper"
        )  # the codec reads its schema once: before the first request, not in it
        profile = load_profile(args.profile)
        with Bus.open(args.connect, name="orchestrator", wait_s=None, stop=stop) as bus:
            folder = make_folder(data_dir_of(args.data_dir) / "orchestrator")
            # Before the journal is touched: whoever leads is writing it.
            lock_folder(folder, Candidate.own())
            claim(bus, profile.robot_ids)
            orchestrator = Orchestrator(bus, profile, folder / "journal.jsonl", args.capacity)
            try:
                orchestrator.start()
                stop.wait()
            finally:
                orchestrator.close()

    return run_service("orchestrator", body)


if __name__ == "__main__":
    raise SystemExit(main())
