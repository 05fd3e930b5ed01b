# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The SDK of an autonomy framework or a notebook, and of the driver of a sensor::

with Client() as c:
    dem = c.request("dem", robot="mana", region="circle:0,0,10")
    print(dem.value.layer("mean"), dem.delivered["coverage"])

with Sensor("imu/sample", IMUSensors, frame="mana/imu") as imu:
    imu.publish(IMUSensors(acc=acc_m_s2, gyro=gyro_rad_s), stamp_ns)
"""

from cdff_common.client.answer import Answer
from cdff_common.client.async_client import AsyncClient
from cdff_common.client.client import Client
from cdff_common.client.sensor import Sensor, SensorStatus
from cdff_common.client.sensor_modes import ActiveMode
from cdff_common.client.stamp_monitor import ClockLimits
from cdff_common.client.stored_product import StoredProduct

__all__ = [
    "ActiveMode",
    "Answer",
    "AsyncClient",
    "Client",
    "ClockLimits",
    "Sensor",
    "SensorStatus",
    "StoredProduct",
]
