# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A task with the interfaces of Orocos RTT, by omniORB; it runs in the environment of the peers.

python rock_servant.py IDL_FOLDER NAMES_PORT VALUES.json RECEIVED.json

``VALUES.json`` has the samples of each output port: {port: {"type", "idl", "values": [...], "period_s"}};
with "repeat" they are sent again and again, with "stamp_now" with the time at which they are read. Every
sample that is written to the input port ``pose_samples`` is a line of ``RECEIVED.json``.
"""

from __future__ import annotations

import contextlib
import json
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

folder, names_port, values_path, received_path = sys.argv[1:]
_OUT = tempfile.mkdtemp()
for _name in ("rtt", "base"):
    subprocess.run(
        [
            str(pathlib.Path(sys.executable).parent / "omniidl"),
            "-bpython",
            f"-C{_OUT}",
            f"{folder}/{_name}.idl",
        ],
        check=True,
    )
sys.path.insert(0, _OUT)

import base as base_types  # noqa: E402
import CosNaming  # noqa: E402
import RTT.corba  # noqa: E402
import RTT__POA.corba  # noqa: E402
from omniORB import CORBA, findType, tcInternal  # noqa: E402
from omniORB import any as corba_any  # noqa: E402

_SPEC = json.loads(pathlib.Path(values_path).read_text())
_INPUTS = {"pose_samples": ("/base/samples/RigidBodyState", base_types.RigidBodyState)}


def _from_descriptor(kind, value):
    """Return a value of an IDL type from plain data."""
    return _element(findType(kind._NP_RepositoryId), value)


def _element(descriptor, value):
    if isinstance(descriptor, tuple):
        number = descriptor[0]
        if number == tcInternal.tv_struct:
            cls, members = descriptor[1], descriptor[4:]
            return cls(
                *[_element(kind, value[name]) for name, kind in zip(members[::2], members[1::2], strict=True)]
            )
        if number == tcInternal.tv_enum:
            return next(item for item in descriptor[3] if item._n == value)
        if number in (tcInternal.tv_sequence, tcInternal.tv_array):
            if descriptor[1] == tcInternal.tv_octet:
                return bytes(value)
            return [_element(descriptor[1], item) for item in value]
        if number == tcInternal.tv_alias:
            return _element(descriptor[3], value)
        if number == tcInternal.tv_string:
            return str(value)
    return value


class Channel(RTT__POA.corba.CChannelElement):
    def __init__(self, port):
        self._port, self._next = port, 0
        self._start = time.monotonic()

    def channelReady(self, policy):
        return True

    def read(self, copy_old):
        spec = _SPEC[self._port]
        period = spec.get("period_s", 0.0)
        is_due = time.monotonic() - self._start >= self._next * period
        count = len(spec["values"])
        if not is_due or (self._next >= count and not spec.get("repeat")):
            return RTT.corba.CNoData, CORBA.Any(CORBA.TC_null, None)
        kind = getattr(base_types, spec["idl"])
        value = _VALUES[self._port][self._next % count]
        if spec.get("stamp_now"):
            value.time.microseconds = time.time_ns() // 1000
        self._next += 1
        return RTT.corba.CNewData, CORBA.Any(CORBA.TypeCode(kind._NP_RepositoryId), value)

    def write(self, sample):
        kind = _INPUTS[self._port][1]
        if not sample.typecode().equivalent(CORBA.TypeCode(kind._NP_RepositoryId)):
            return RTT.corba.CWriteFailure
        plain = corba_any.from_any(sample, keep_structs=False)
        with pathlib.Path(received_path).open("a") as file:
            file.write(json.dumps(plain) + "\n")
        return RTT.corba.CWriteSuccess

    def disconnect(self):
        pass


class Ports(RTT__POA.corba.CDataFlowInterface):
    def getPortDescriptions(self):
        out = [
            RTT.corba.CPortDescription(RTT.corba.COutput, name, "", spec["type"])
            for name, spec in _SPEC.items()
        ]
        return out + [
            RTT.corba.CPortDescription(RTT.corba.CInput, name, "", kind)
            for name, (kind, _) in _INPUTS.items()
        ]

    def _channel(self, known, port, policy):
        if port not in known:
            raise RTT.corba.CNoSuchPortException()
        return Channel(port)._this(), policy

    def buildChannelOutput(self, port, policy):
        return self._channel(_INPUTS, port, policy)

    def buildChannelInput(self, port, policy):
        return self._channel(_SPEC, port, policy)


class Task(RTT__POA.corba.CTaskContext):
    def __init__(self):
        self._ports = Ports()

    def getName(self):
        return "sensor_task"

    def ports(self):
        return self._ports._this()


def main():
    orb = CORBA.ORB_init(
        [
            "servant",
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
    context_name = [CosNaming.NameComponent("TaskContexts", "")]
    with contextlib.suppress(CosNaming.NamingContext.AlreadyBound):
        root.bind_new_context(context_name)
    task = Task()
    root.rebind([*context_name, CosNaming.NameComponent("sensor_task", "")], task._this())
    print("ready", flush=True)
    threading.Event().wait()


_VALUES = {}
for _port, _spec in _SPEC.items():
    _VALUES[_port] = [_from_descriptor(getattr(base_types, _spec["idl"]), value) for value in _spec["values"]]

if __name__ == "__main__":
    main()
