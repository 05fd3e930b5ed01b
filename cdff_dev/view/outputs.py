# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of a scene: a window, the browser, a file, or Foxglove; servers listen on this machine only."""

from __future__ import annotations

import argparse
import atexit
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from cdff_common.errors import InputError, UnavailableError
from cdff_common.output import check_file, format_of_suffix, write_file
from cdff_dev.ports import free_port
from cdff_dev.view.drawings import Scene

if TYPE_CHECKING:
    import rerun as rr

    from cdff_dev.view.feed import Contents

_LOOPBACK = "127.0.0.1"
#: Default port of Foxglove's own WebSocket servers.
FOXGLOVE_PORT = 8765
#: Longest start of the viewer, seconds.
_START_S = 60.0
#: Variables of the environment, of which one names the display.
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
_WITHOUT = "use --web, or --save NAME.rrd"


@dataclass(frozen=True, slots=True)
class Output:
    """A scene and its place.

    Attributes
    ----------
    scene : Scene
    place : str
        File or URL, for the user.
    arrange : callable
        Sends or writes the layout for the contents so far.
    serves : bool
        Whether this process serves it until it is interrupted.
    viewer : subprocess.Popen or None
        Process of the viewer that ends with this one.
    """

    scene: Scene
    place: str
    arrange: Callable[[Contents], None]
    serves: bool = False
    viewer: subprocess.Popen[bytes] | None = None

    def wait(self) -> None:
        """Serve until interrupted."""
        try:
            while self.serves and (self.viewer is None or self.viewer.poll() is None):
                time.sleep(0.5)
        except KeyboardInterrupt:
            pass
        finally:
            self.scene.close()


def output_of(args: argparse.Namespace) -> Output:
    """Return the output of the arguments of ``cdff view``.

    Raises StorageError for a file that cannot be written, and InputError for a layout of Rerun, which is
    part of its recording.
    """
    form = None if args.save is None else format_of_suffix(args.save, ("rrd", "mcap"), "view")
    if args.layout is not None and not (args.foxglove or form == "mcap"):
        raise InputError(f"--layout {args.layout}: only with --foxglove or --save NAME.mcap")
    for path in (args.save, args.layout):
        if path is not None:
            check_file(path)
    if args.foxglove:
        return _foxglove_server(args.port or FOXGLOVE_PORT, args.layout)
    if args.save is None:
        return rerun_viewer(web=args.web)
    return mcap_file(args.save, args.layout) if form == "mcap" else rerun_file(args.save)


def rerun_file(path: Path) -> Output:
    """Return the output to a file of Rerun."""
    import rerun as rr

    recording = rr.RecordingStream("cdff")
    recording.save(path)
    return _rerun_output(recording, str(path))


def rerun_viewer(*, web: bool = False) -> Output:
    """Start the viewer in a window, or for the browser.

    Without ``--bind`` its servers listen on every interface. It sends no usage statistics, unless the
    environment has ``RERUN_ANALYTICS``. Raises UnavailableError without a display for the window.
    """
    import rerun as rr

    if not web and sys.platform == "linux" and not any(os.environ.get(name) for name in _DISPLAYS):
        raise UnavailableError(
            f"no display for the window of the viewer ({', '.join(_DISPLAYS)}); {_WITHOUT}"
        )
    port, web_port = free_port(), free_port()
    command = [rerun_program(), "--bind", _LOOPBACK, "--port", str(port)]
    if web:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    else:
        command += ["--expect-data-soon", "--hide-welcome-screen"]
    environment = {"RERUN_ANALYTICS": "0"} | os.environ
    viewer = subprocess.Popen(command, start_new_session=not web, env=environment)
    if web:  # ends with this process
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        atexit.register(viewer.terminate)
    endpoint = f"{_LOOPBACK}:{port}"
    _wait_for(port, viewer)
    recording = rr.RecordingStream("cdff")
    recording.connect_grpc(f"rerun+http://{endpoint}/proxy")
    if not web:
        return _rerun_output(recording, "window of Rerun")
    source = quote(f"rerun+http://{endpoint}/proxy", safe="")
    return _rerun_output(recording, f"http://{_LOOPBACK}:{web_port}/?url={source}", viewer)


def rerun_program() -> str:
    """Return the program of the viewer; ``python -m rerun`` starts it as a child that outlives its parent."""
    import rerun_cli

    return str(Path(rerun_cli.__file__).parent / "rerun")


def _wait_for(port: int, viewer: subprocess.Popen[bytes]) -> None:
    """Wait until the viewer listens; raises UnavailableError if it ends or does not start."""
    deadline_s = time.monotonic() + _START_S
    while time.monotonic() < deadline_s and viewer.poll() is None:
        with suppress(OSError), socket.create_connection((_LOOPBACK, port), timeout=1.0):
            return
        time.sleep(0.1)
    raise UnavailableError(f"the viewer Rerun did not start; {_WITHOUT}")


def _rerun_output(
    recording: rr.RecordingStream, place: str, viewer: subprocess.Popen[bytes] | None = None
) -> Output:
    """Return the output of a recording of rerun."""
    from cdff_dev.view.blueprint import blueprint
    from cdff_dev.view.rerun_scene import RerunScene

    def arrange(contents: Contents) -> None:
        recording.send_blueprint(blueprint(contents), make_active=True)
        recording.flush()

    return Output(RerunScene(recording), place, arrange, viewer is not None, viewer)


def mcap_file(path: Path, layout: Path | None, place: str | None = None) -> Output:
    """Return the output to an MCAP file, and to a file with the layout."""
    from cdff_dev.view.foxglove_scene import mcap_scene

    return Output(mcap_scene(path), place or str(path), _layout_writer(layout))


def _foxglove_server(port: int, layout: Path | None) -> Output:
    """Return the output to a server that sends each layer at once, for the running system."""
    from cdff_dev.view.foxglove_scene import server_scene

    scene = server_scene(_LOOPBACK, port)
    return Output(scene, f"ws://{_LOOPBACK}:{port}", _layout_writer(layout), serves=True)


def play_in_foxglove(path: Path, port: int) -> None:
    """Serve an MCAP file, which its clients play, until interrupted."""
    from cdff_dev.view.foxglove_playback import PlaybackServer

    server = PlaybackServer(path, _LOOPBACK, port)
    try:
        while True:
            time.sleep(0.5)
    except KeyboardInterrupt:
        pass
    finally:
        server.close()


def _layout_writer(path: Path | None) -> Callable[[Contents], None]:
    """Return a function that writes the layout for Foxglove to a file, if there is one."""
    from cdff_dev.view.foxglove_layout import layout_of

    def write(contents: Contents) -> None:
        if path is not None:
            write_file(path, layout_of(contents).to_json().encode())

    return write
