# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver of a GNSS receiver, for tests on Earth. Replace ``Device``; this one simulates a fixed antenna.

Its samples are for the port ``fix`` of ``position_manager``, with ``fixes: {weighting: kalman}``.
"""

import time
from contextlib import suppress

import numpy as np

from cdff_common.client import Sensor
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance

ROBOT = "mana"
SENSOR = "gnss"
FRAME = f"{ROBOT}/{SENSOR}"  # the phase centre of the antenna; its mount is in the profile
# As in the profile: body.site_lon_deg, site_lat_deg, site_height_m (above the ellipsoid), site_azimuth_deg.
SITE = Anchor(body("earth"), lon_deg=1.4806, lat_deg=43.5606, height_m=150.0)
# A receiver does not measure the orientation. Only the tilt moves an antenna above the base.
SIGMA_TILT_DEG, SIGMA_YAW_DEG = 20.0, 180.0


class Device:
    """Simulated receiver with a solution per second."""

    def read(self) -> tuple[float, float, float, float, float]:
        """Wait for a solution; return longitude, latitude (degrees), height (m), and sigmas (m)."""
        time.sleep(1.0)
        return 1.4807, 43.5607, 151.2, 0.02, 0.04


def main() -> None:
    """Publish positions until Ctrl-C."""
    device = Device()
    with (
        suppress(KeyboardInterrupt),
        Sensor(f"{SENSOR}/fix", TransformWithCovariance, frame="site", child=FRAME, robot=ROBOT) as gnss,
    ):
        while True:
            lon_deg, lat_deg, height_m, sigma_m, sigma_height_m = device.read()
            stamp_ns = gnss.now_ns()  # better: the time of the solution, GPS time minus the leap seconds
            xyz_m = SITE.points([[lon_deg, lat_deg, height_m]])[0]
            tilt, yaw = np.deg2rad([SIGMA_TILT_DEG, SIGMA_YAW_DEG])
            sigmas = [sigma_m, sigma_m, sigma_height_m, tilt, tilt, yaw]
            T = UncertainTransform.from_quaternion(
                xyz_m, xyzw=[0, 0, 0, 1], covariance=np.diag(np.square(sigmas))
            )
            gnss.publish(
                TransformWithCovariance.from_transform(T, parent="site", child=FRAME, stamp_ns=stamp_ns)
            )


if __name__ == "__main__":
    main()
