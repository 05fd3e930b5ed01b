# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The merging of maps as a process, for a profile that says ``merging``.

python -m services.map_merging --profile FILE [--connect tcp/127.0.0.1:7447]
"""

from __future__ import annotations

import argparse
import os
import threading

from cdff_common.bus import Bus, keys
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.interfaces.profile import load_profile
from cdff_common.process import cap_threads, run_service


def main(argv: list[str] | None = None) -> int:
    """Merge until SIGTERM."""
    parser = argparse.ArgumentParser(prog="map_merging", description=__doc__)
    parser.add_argument("--profile", default=os.environ.get("CDFF_PROFILE"))
    parser.add_argument("--connect", default=None, help="router, as tcp/127.0.0.1:7447 (default: CDFF_CONNECT)")
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        if not args.profile:
            raise ConfigurationError("no profile: give --profile FILE or set CDFF_PROFILE")
        profile = load_profile(args.profile)
        from services.map_merging.archive import Archive  # heavy: after the thread caps
        from services.map_merging.rounds import Rounds, follow

        config = profile.merging or MergingConfig.model_validate({})
        with Bus.open(args.connect, name="map_merging", wait_s=None, stop=stop) as bus:
            rounds = Rounds(Archive(bus, config), config, profile.robot_ids)
            bus.declare_alive(keys.GROUND, "map_merging")
            follow(bus, rounds, stop)

    return run_service("map_merging", body)


if __name__ == "__main__":
    raise SystemExit(main())
