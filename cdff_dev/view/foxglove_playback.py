# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Playback of an MCAP file by a WebSocket server of Foxglove: play, pause, speed and jumps by its clients."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foxglove
from foxglove.websocket import (
    Capability,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from cdff_common.errors import InputError, UnavailableError
from cdff_common.extras import import_extra

#: Topic of the transforms, of which one message does not contain all.
_TRANSFORMS = "/tf"
#: Longest time between two states that clients receive, seconds.
_STATE_S = 0.2
#: Time without a new subscription after which those of a client are complete, seconds.
_SUBSCRIPTIONS_S = 0.3


class PlaybackServer(ServerListener):
    """Server that plays a file from its start when the first client subscribes, then as its clients request.

    Parameters
    ----------
    path : Path
        MCAP file.
    host, port : str, int
        Address to listen on.

    Raises
    ------
    InputError
        If the file has no messages.
    UnavailableError
        If the port is in use.
    """

    def __init__(self, path: Path, host: str, port: int) -> None:
        self._path = path
        self._make_reader = import_extra("mcap.reader").make_reader
        with path.open("rb") as file:
            summary = self._make_reader(file).get_summary()
        if summary is None or summary.statistics is None or not summary.statistics.message_count:
            raise InputError(f"{path}: no messages to play")
        statistics = summary.statistics
        self._t0_ns, self._t1_ns = statistics.message_start_time, statistics.message_end_time
        self._changed = threading.Condition()
        self._is_playing, self._is_closed, self._speed = False, False, 1.0
        self._was_started = False
        self._seek_ns: int | None = None
        self._refresh: threading.Timer | None = None
        self._now_ns = self._t0_ns
        self._context = foxglove.Context()  # the channels end with it
        try:
            self._server = foxglove.start_server(
                name="cdff",
                host=host,
                port=port,
                context=self._context,
                capabilities=[Capability.Time, Capability.PlaybackControl],
                server_listener=self,
                playback_time_range=(self._t0_ns, self._t1_ns),
            )
        except (OSError, RuntimeError) as error:
            raise UnavailableError(
                f"Foxglove server on {host}:{port}: {error}; choose another with --port"
            ) from error
        self._channels = {
            number: foxglove.Channel(
                channel.topic,
                schema=foxglove.Schema(
                    name=summary.schemas[channel.schema_id].name,
                    encoding=summary.schemas[channel.schema_id].encoding,
                    data=summary.schemas[channel.schema_id].data,
                ),
                message_encoding=channel.message_encoding,
                context=self._context,
            )
            for number, channel in summary.channels.items()
        }
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the playback and the server."""
        with self._changed:
            self._is_closed = True
            if self._refresh is not None:
                self._refresh.cancel()
            self._changed.notify_all()
        self._thread.join()
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the current state when the subscriptions are complete; start with the first client."""
        with self._changed:
            if self._refresh is not None:
                self._refresh.cancel()
            self._refresh = threading.Timer(_SUBSCRIPTIONS_S, self._send_again)
            self._refresh.daemon = True
            self._refresh.start()

    def on_playback_control_request(self, playback_control_request: PlaybackControlRequest) -> PlaybackState:
        """Play, pause, or continue at another time or speed."""
        request = playback_control_request
        with self._changed:
            self._was_started = True
            self._is_playing = request.playback_command == PlaybackCommand.Play
            self._speed = max(request.playback_speed, 1e-3)
            if request.seek_time is not None:
                self._seek_ns = min(max(request.seek_time, self._t0_ns), self._t1_ns)
                self._now_ns = self._seek_ns
            elif self._is_playing and self._now_ns >= self._t1_ns:
                self._seek_ns = self._now_ns = self._t0_ns  # again from the start
            self._changed.notify_all()
            return self._state(request.seek_time is not None, request.request_id)

    def _send_again(self) -> None:
        with self._changed:
            if not self._was_started:
                self._was_started = self._is_playing = True
            self._seek_ns = self._now_ns if self._seek_ns is None else self._seek_ns
            self._changed.notify_all()

    def _run(self) -> None:
        """Play until closed; each jump is a new pass through the file."""
        start_ns = self._awaited_seek()
        while start_ns is not None:
            self._send_until(start_ns)
            start_ns = self._play_from(start_ns)

    def _play_from(self, start_ns: int) -> int | None:
        """Send the messages from a time on; return the time of a jump, or None if closed."""
        for channel_id, stamp_ns, data in self._messages(start_ns + 1, self._t1_ns + 1):
            with self._changed:
                while self._seek_ns is None and not self._is_closed:
                    wait_s = (stamp_ns - self._now_ns) * 1e-9 / self._speed
                    if self._is_playing and wait_s <= 0.0:
                        break
                    step_s = min(wait_s, _STATE_S) if self._is_playing else None
                    if not self._changed.wait(step_s) and step_s is not None:
                        self._now_ns += round(step_s * self._speed * 1e9)
                        self._server.broadcast_time(self._now_ns)
                        self._server.broadcast_playback_state(self._state(False, None))
                if self._seek_ns is not None or self._is_closed:
                    return self._taken_seek()
                self._now_ns = max(self._now_ns, stamp_ns)
            self._channels[channel_id].log(data, log_time=stamp_ns)
        with self._changed:
            self._now_ns, self._is_playing = self._t1_ns, False
            self._server.broadcast_playback_state(self._state(False, None))
        return self._awaited_seek()

    def _awaited_seek(self) -> int | None:
        """Wait for a jump; return its time, or None if closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or self._seek_ns is not None)
            return self._taken_seek()

    def _send_until(self, stamp_ns: int) -> None:
        """Send the state at a time: the transforms, and the last message of each other topic."""
        last: dict[int, tuple[int, bytes]] = {}
        for channel_id, log_ns, data in self._messages(self._t0_ns, stamp_ns + 1):
            if self._channels[channel_id].topic() == _TRANSFORMS:
                self._channels[channel_id].log(data, log_time=log_ns)
            else:
                last[channel_id] = (log_ns, data)
        for channel_id, (log_ns, data) in last.items():
            self._channels[channel_id].log(data, log_time=log_ns)

    def _messages(self, start_ns: int, end_ns: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield channel, time and data of the messages of an interval, without its end."""
        with self._path.open("rb") as file:
            reader = self._make_reader(file)
            for _, channel, message in reader.iter_messages():
                if message.log_time >= end_ns:
                    return
                if message.log_time >= start_ns:
                    yield channel.id, message.log_time, message.data

    def _taken_seek(self) -> int | None:
        seek_ns, self._seek_ns = self._seek_ns, None
        return None if self._is_closed else seek_ns

    def _state(self, did_seek: bool, request_id: str | None) -> PlaybackState:
        """Return the state of the playback for the viewer."""
        is_over = self._now_ns >= self._t1_ns and not self._is_playing
        status = (
            PlaybackStatus.Playing
            if self._is_playing
            else PlaybackStatus.Ended
            if is_over
            else PlaybackStatus.Paused
        )
        return PlaybackState(status, self._now_ns, self._speed, did_seek, request_id)
