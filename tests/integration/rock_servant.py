# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Task with the interfaces of Orocos RTT, implemented with omniORB (``make peers``: build/rock-peers).

python rock_servant.py IDL_FOLDER NAMES_PORT VALUES.json RECEIVED.json

``VALUES.json`` contains the samples of each output port:
``{port: {"type", "idl", "values": [...], "period_s"}}``. A name ``port`` belongs to the task ``sensor_task``,
a name ``task.port`` to another task. With "repeat" the task sends the samples repeatedly; with "stamp_now"
their stamp is the time of the read. A task without an output port ``pose_samples`` has an input port of this
name; each sample that is written to this port becomes a line of ``RECEIVED.json``.
"""

from __future__ import annotations

import contextlib
import json
import pathlib
import sys
import threading
import time

folder, names_port, values_path, received_path = sys.argv[1:]
sys.path.insert(0, folder)

from compiled_interfaces import compile_interfaces  # noqa: E402

compile_interfaces(folder)

import base as base_types  # noqa: E402
import CosNaming  # noqa: E402
import RTT.corba  # noqa: E402
import RTT__POA.corba  # noqa: E402
from omniORB import CORBA, findType, tcInternal  # noqa: E402
from omniORB import any as corba_any  # noqa: E402

_SPEC = {
    port if "." in port else f"sensor_task.{port}": spec
    for port, spec in json.loads(pathlib.Path(values_path).read_text()).items()
}
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
    """Connection to an input port, or to the output port ``task.port``."""

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
    def __init__(self, task):
        names = {key.rpartition(".")[2]: key for key in _SPEC if key.rpartition(".")[0] == task}
        self._outputs = names
        self._inputs = {name: name for name in _INPUTS if name not in names}

    def getPortDescriptions(self):
        out = [
            RTT.corba.CPortDescription(RTT.corba.COutput, name, "", _SPEC[key]["type"])
            for name, key in self._outputs.items()
        ]
        return out + [
            RTT.corba.CPortDescription(RTT.corba.CInput, name, "", _INPUTS[name][0]) for name in self._inputs
        ]

    def _channel(self, known, port, policy):
        if port not in known:
            raise RTT.corba.CNoSuchPortException()
        return Channel(known[port])._this(), policy

    def buildChannelOutput(self, port, policy):
        return self._channel(self._inputs, port, policy)

    def buildChannelInput(self, port, policy):
        return self._channel(self._outputs, port, policy)


class Task(RTT__POA.corba.CTaskContext):
    def __init__(self, name):
        self._name, self._ports = name, Ports(name)

    def getName(self):
        return self._name

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
    tasks = [Task(name) for name in sorted({key.rpartition(".")[0] for key in _SPEC})]
    for task in tasks:
        root.rebind([*context_name, CosNaming.NameComponent(task.getName(), "")], task._this())
    print("ready", flush=True)
    threading.Event().wait()


_VALUES = {}
for _port, _spec in _SPEC.items():
    _VALUES[_port] = [_from_descriptor(getattr(base_types, _spec["idl"]), value) for value in _spec["values"]]

if __name__ == "__main__":
    main()
