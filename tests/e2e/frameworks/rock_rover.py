# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rover with tasks of ROCK, implemented with omniORB: test_framework_rovers.py runs it in its environment.

``rock_rover.py IDL_FOLDER NAMES_PORT DRIVE.json`` has a task ``rover`` with the interfaces of Orocos RTT. Its
port ``laser_scans`` has the sweeps of a drive, then the last one repeatedly. When its input ports have
received pose, transformation and cloud, it requests a DEM by the operation of the task ``cdff``, and prints
all as JSON.
"""

from __future__ import annotations

import array
import contextlib
import json
import pathlib
import sys
import threading
import time

from program_exit import run_and_exit

folder, names_port, drive_path = sys.argv[1:]
sys.path.insert(0, folder)

from compiled_interfaces import compile_interfaces  # noqa: E402

compile_interfaces(folder)

import base as base_types  # noqa: E402
import CosNaming  # noqa: E402
import RTT.corba  # noqa: E402
import RTT__POA.corba  # noqa: E402
from omniORB import CORBA  # noqa: E402
from omniORB import any as corba_any  # noqa: E402

PERIOD_S, SWEEP_US, LIMIT_S = 0.5, 100_000, 150.0
_NAMES = [CosNaming.NameComponent("TaskContexts", "")]
DRIVE = json.loads(pathlib.Path(drive_path).read_text())
ROWS, COLUMNS = len(DRIVE["elevations"]), len(DRIVE["azimuths"])
SIZE = ROWS * COLUMNS
RANGES = array.array("f", pathlib.Path(DRIVE["ranges"]).read_bytes())

STATE, DEPTH_MAP, CLOUD = (f"/base/samples/{name}" for name in ("RigidBodyState", "DepthMap", "Pointcloud"))
OUTPUTS = {"laser_scans": DEPTH_MAP, "estimated_state": STATE, "own_cloud": CLOUD}
INPUTS = {"pose_samples": STATE, "dynamic_transformations": STATE, "map_cloud": CLOUD}
KINDS = {STATE: base_types.RigidBodyState, DEPTH_MAP: base_types.DepthMap, CLOUD: base_types.Pointcloud}
received = {port: [] for port in INPUTS}
starts_ns = []
lock = threading.Lock()


def sweep(index):
    """Return the depth map of a sweep that ends now."""
    start_us = time.time_ns() // 1000 - SWEEP_US
    starts_ns.append(start_us * 1000)
    first = min(index, len(RANGES) // SIZE - 1) * SIZE
    times = [base_types.Stamp(start_us + SWEEP_US * (i + 1) // COLUMNS) for i in range(COLUMNS)]
    return base_types.DepthMap(
        time=base_types.Stamp(start_us),
        timestamps=times,
        vertical_projection=base_types.POLAR,
        horizontal_projection=base_types.POLAR,
        vertical_interval=[-angle for angle in DRIVE["elevations"]],
        horizontal_interval=DRIVE["azimuths"],
        vertical_size=ROWS,
        horizontal_size=COLUMNS,
        distances=list(RANGES[first : first + SIZE]),
        remissions=[],
    )


def own_sample(type_name):
    """Return a sample of the rover's own estimates, which states the type of a port to the gateway."""
    stamp, zero = base_types.Stamp(time.time_ns() // 1000), base_types.Vector3([0.0] * 3)
    if type_name == CLOUD:
        return base_types.Pointcloud(stamp, [], [])
    matrix = base_types.Matrix3([0.0] * 9)
    rotation = base_types.Quaternion([0.0] * 3, 1.0)
    return base_types.RigidBodyState(
        stamp, "body", "world", zero, matrix, rotation, matrix, zero, matrix, zero, matrix
    )


class Channel(RTT__POA.corba.CChannelElement):
    """Connection to a port."""

    def __init__(self, port):
        self._port, self._count, self._due_s = port, 0, time.monotonic()

    def channelReady(self, policy):
        return True

    def read(self, copy_old):
        now_s = time.monotonic()
        if now_s < self._due_s:
            return RTT.corba.CNoData, CORBA.Any(CORBA.TC_null, None)
        type_name = OUTPUTS[self._port]
        value = sweep(self._count) if type_name == DEPTH_MAP else own_sample(type_name)
        self._count, self._due_s = self._count + 1, now_s + PERIOD_S
        return RTT.corba.CNewData, CORBA.Any(CORBA.TypeCode(KINDS[type_name]._NP_RepositoryId), value)

    def write(self, sample):
        kind = KINDS[INPUTS[self._port]]
        if not sample.typecode().equivalent(CORBA.TypeCode(kind._NP_RepositoryId)):
            return RTT.corba.CWriteFailure
        with lock:
            received[self._port].append(sample.value())
        return RTT.corba.CWriteSuccess

    def disconnect(self):
        pass


class Ports(RTT__POA.corba.CDataFlowInterface):
    def getPortDescriptions(self):
        return [
            RTT.corba.CPortDescription(direction, name, "", type_name)
            for direction, ports in ((RTT.corba.COutput, OUTPUTS), (RTT.corba.CInput, INPUTS))
            for name, type_name in ports.items()
        ]

    def _channel(self, known, port, policy):
        if port not in known:
            raise RTT.corba.CNoSuchPortException()
        return Channel(port)._this(), policy

    def buildChannelOutput(self, port, policy):
        return self._channel(INPUTS, port, policy)

    def buildChannelInput(self, port, policy):
        return self._channel(OUTPUTS, port, policy)


class Task(RTT__POA.corba.CTaskContext):
    def __init__(self):
        self._ports = Ports()

    def getName(self):
        return "rover"

    def getTaskState(self):
        return RTT.corba.CRunning

    def ports(self):
        return self._ports._this()


def request(root, query):
    """Call the operation of the gateway's task; return its operations, and type and content of a product."""
    found = root.resolve([*_NAMES, CosNaming.NameComponent("cdff", "")])
    task = found._narrow(RTT.corba.CTaskContext)
    assert task.getTaskState() == RTT.corba.CRunning
    service = task.getProvider("this")
    empty = CORBA.Any(CORBA.TypeCode(CORBA.id(CORBA.OctetSeq)), b"")
    arguments = [corba_any.to_any(query), CORBA.Any(CORBA.TC_double, 15.0), empty]
    result, arguments = service.callOperation("requestProduct", arguments)
    described = [argument.type for argument in service.getArguments("requestProduct")]
    return [service.getOperations(), described], result.value(), arguments[2].value()


def state_of(value):
    """Return stamp in nanoseconds, position and quaternion x y z w."""
    return [value.time.microseconds * 1000, *value.position.data, *value.orientation.im, value.orientation.re]


def frames_of(values):
    return sorted({(value.targetFrame, value.sourceFrame) for value in values})


def main():
    orb = CORBA.ORB_init(
        [
            "rover",
            "-ORBInitRef",
            f"NameService=corbaloc::127.0.0.1:{names_port}/NameService",
            "-ORBendPoint",
            "giop:tcp:127.0.0.1:",
        ],
        CORBA.ORB_ID,
    )
    poa = orb.resolve_initial_references("RootPOA")
    poa._get_the_POAManager().activate()
    root = orb.resolve_initial_references("NameService")._narrow(CosNaming.NamingContext)
    with contextlib.suppress(CosNaming.NamingContext.AlreadyBound):
        root.bind_new_context(_NAMES)
    task = Task()
    root.rebind([*_NAMES, CosNaming.NameComponent("rover", "")], task._this())
    end_s, product, refusal, interface = time.monotonic() + LIMIT_S, ("", b""), "", []
    while time.monotonic() < end_s and not product[0]:
        time.sleep(0.5)
        if len(starts_ns) <= len(RANGES) // SIZE + 4 or not all(received.values()):
            continue
        try:
            interface, *product = request(root, "type=dem;region=bbox:0,-2,4,2;resolution_m=0.1")
        except RTT.corba.CCallError as error:
            refusal = error.what
    denied = ""
    try:
        request(root, "type=mesh")
    except RTT.corba.CCallError as error:
        denied = error.what
    with lock:
        poses, tree, clouds = received.values()
        result = {
            "starts_ns": starts_ns,
            "poses": [state_of(value) for value in poses],
            "pose_frames": frames_of(poses),
            "tree_frames": frames_of(tree),
            "tree": [state_of(value) for value in tree],
            "points": [list(point.data) for cloud in clouds for point in cloud.points],
            "interface": interface,
            "dem": [product[0], bytes(product[1]).hex()],
            "denied": denied,
            "refusal": refusal,
        }
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    run_and_exit(main)
