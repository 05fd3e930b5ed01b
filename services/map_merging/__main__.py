# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Process of map merging, for a profile with a section ``merging``.

python -m services.map_merging --profile FILE [--connect tcp/127.0.0.1:7447]
"""

from __future__ import annotations

import argparse
import threading

from cdff_common.bus import Bus, keys
from cdff_common.cli import add_connect_option, add_profile_option
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.interfaces.profile import load_profile
from cdff_common.loops import Loops
from cdff_common.process import cap_threads, run_service
from services.alarm_reporter import AlarmReporter
from services.alarms import Alarms
from services.memory_budget import memory_budget_mb, memory_check
from services.signing import sign_of_environment


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    parser = argparse.ArgumentParser(prog="map_merging", description=__doc__)
    add_profile_option(parser, required=True)
    add_connect_option(parser)
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        profile = load_profile(args.profile)
        from services.map_merging.archive import MapArchive  # heavy: after the thread caps
        from services.map_merging.merging_rounds import MergingRounds, follow

        config = profile.merging or MergingConfig.model_validate({})
        with Bus.open(args.connect, name="map_merging", wait_s=None, stop=stop) as bus:
            archive = MapArchive(bus, config, sign_of_environment() if profile.sign else None)
            rounds = MergingRounds(archive, config, profile.robot_ids)
            alarms, loops = Alarms(), Loops()
            check = memory_check(alarms, "map_merging", memory_budget_mb())
            reporter = AlarmReporter(bus, keys.GROUND, "map_merging", alarms, loops.add("alarms"), (check,))
            add_check(loops.problem)
            add_check(bus.loops.problem)
            bus.declare_alive(keys.GROUND, "map_merging")
            follow(bus, rounds, stop)
            reporter.close()

    return run_service("map_merging", body)


if __name__ == "__main__":
    raise SystemExit(main())
