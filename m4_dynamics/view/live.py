"""A run in the browser as it happens: a small server in threads of this process, which end with it.

The page is meshcat's viewer. It gets the scene once and then a frame of transforms at a time; a viewer that is slow
misses frames, the simulation never waits for one.
"""

from __future__ import annotations

import asyncio
import html
import json
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict
from importlib import resources
from string import Template
from types import TracebackType
from typing import Any, Self

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.recorder import Recorder
from m4_dynamics.view.bodies import joint_path
from m4_dynamics.view.live_scene import LiveScene
from m4_dynamics.view.offline_page import viewer_program
from m4_dynamics.view.serving import LOOPBACK
from m4_dynamics.view.three import Command, pack

__all__ = ["LiveView"]

_FRAMES_PER_SECOND = 30.0
_LAST_WORDS = 0.3  # [s] that the server gets to say that the run has ended


class LiveView:
    """Shows a run in browsers and holds the simulation to real time; use it as a context manager."""

    def __init__(self, robot: Robot, *, host: str = LOOPBACK, port: int = 0) -> None:
        """Take a port and answer on it at once.

        Args:
            robot: The robot.
            host: Address to listen on.
            port: Port to listen on; 0 takes a free one.

        Raises:
            InvalidSettingError: The address or the port cannot be had.
        """
        if not 0 <= port <= 65535:
            raise InvalidSettingError("port", port, "a number from 0 to 65535")
        try:
            sockets = tornado.netutil.bind_sockets(port, host)
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InvalidSettingError("address", f"{host}:{port}", f"one that is free here ({reason})") from error
        shown = host if host not in ("", "0.0.0.0", "::") else LOOPBACK
        #: Where the page is.
        self.url = f"http://{shown}:{sockets[0].getsockname()[1]}/"
        self._robot = robot
        self._scene: LiveScene | None = None
        self._greeting: tuple[bytes, str] | None = None  # scene and words that a new viewer gets
        self._clients: set[_Channel] = set()
        self._connected = threading.Event()
        self._started: float | None = None
        self._next = 0.0
        self._loop = asyncio.new_event_loop()
        self._page = _page(robot)
        self._thread = threading.Thread(target=self._serve, args=(sockets,), name="live view", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def wait_for_viewer(self, seconds: float) -> bool:
        """Wait until somebody looks, at most for so long [s]; returns whether somebody does."""
        return self._connected.wait(seconds)

    def observe(self, recorder: Recorder) -> None:
        """Show a run's last row, and wait until real time has caught up with it.

        Args:
            recorder: The run; it is only read.
        """
        now = recorder.plant.time
        if self._scene is None or self._started is None:
            self._started = time.monotonic() - now
            self._scene = self._set_up(recorder)
        if now >= self._next:
            self._next = now + 1.0 / _FRAMES_PER_SECOND
            words = {"time": round(now, 3), "phase": recorder.phase_name, "readouts": self._scene.readouts()}
            self._send(_batch(self._scene.frame()), json.dumps(words))
        ahead = self._started + now - time.monotonic()
        if ahead > 0.0:
            time.sleep(ahead)

    def close(self) -> None:
        """Tell the viewers that the run has ended, and give the port back."""
        if not self._thread.is_alive():
            return
        self._send(b"", json.dumps({"ended": True}))
        self._loop.call_soon_threadsafe(self._stopping.set)
        self._thread.join()

    def _serve(self, sockets: Sequence[Any]) -> None:
        asyncio.set_event_loop(self._loop)
        self._stopping = asyncio.Event()
        try:
            self._loop.run_until_complete(self._answer(sockets))
        finally:
            self._loop.close()

    async def _answer(self, sockets: Sequence[Any]) -> None:
        application = tornado.web.Application(
            [("/", _Page, {"page": self._page}), ("/channel", _Channel, {"view": self})],
            log_function=lambda handler: None,
        )
        server = tornado.httpserver.HTTPServer(application)
        server.add_sockets(sockets)
        await self._stopping.wait()
        server.stop()
        clients = list(self._clients)
        for client in clients:
            client.close()
        if clients:
            await asyncio.sleep(_LAST_WORDS)
        await server.close_all_connections()

    def greet(self, client: _Channel) -> None:
        """Send a new viewer the scene, as soon as there is one; called on the server's thread."""
        self._clients.add(client)
        if self._greeting is not None:
            client.give(*self._greeting)
        self._connected.set()

    def forget(self, client: _Channel) -> None:
        """Send a viewer nothing any more; called on the server's thread."""
        self._clients.discard(client)

    def _set_up(self, recorder: Recorder) -> LiveScene:
        """Build the scene and send it to those who look already."""
        scene = LiveScene(self._robot, recorder)
        legend = [asdict(entry) for entry in scene.legend]
        greeting = _batch(scene.commands), json.dumps({"legend": legend, "scale": scene.scale})

        def publish() -> None:
            self._greeting = greeting
            for client in self._clients:
                client.give(*greeting)

        self._loop.call_soon_threadsafe(publish)
        return scene

    def _send(self, frame: bytes, words: str) -> None:
        self._loop.call_soon_threadsafe(self._broadcast, frame, words)

    def _broadcast(self, frame: bytes, words: str) -> None:
        for client in list(self._clients):
            client.offer(frame, words)


class _Page(tornado.web.RequestHandler):
    """The page at the root."""

    def initialize(self, page: str) -> None:
        self._page = page

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.finish(self._page)


class _Channel(tornado.websocket.WebSocketHandler):
    """One viewer; requests from pages of other origins are refused by Tornado."""

    def initialize(self, view: LiveView) -> None:
        self._view = view
        self._tasks: set[asyncio.Future[None]] = set()
        self._ready = False

    def open(self, *args: str, **kwargs: str) -> None:
        self._view.greet(self)

    def on_message(self, message: str | bytes) -> None:
        """A viewer says that it has drawn its last frame."""
        self._ready = True

    def on_close(self) -> None:
        self._view.forget(self)

    def give(self, scene: bytes, words: str) -> None:
        """Send the scene and its legend."""
        self._ready = True
        self._write(scene)
        self._write(words)

    def offer(self, frame: bytes, words: str) -> None:
        """Send a frame and words, unless the last one is not drawn yet; the words that end a run always go."""
        if frame and not self._ready:
            return
        if frame:
            self._ready = False
            self._write(frame)
        self._write(words)

    def _write(self, message: str | bytes) -> None:
        try:
            sent = self.write_message(message, binary=isinstance(message, bytes))
        except tornado.websocket.WebSocketClosedError:
            self._view.forget(self)
            return
        task = asyncio.ensure_future(_quietly(sent))
        self._tasks.add(task)  # asyncio itself keeps no hold of it
        task.add_done_callback(self._tasks.discard)


async def _quietly(sent: Any) -> None:
    """Wait for a message to be sent; a viewer may leave meanwhile."""
    try:
        await sent
    except (tornado.websocket.WebSocketClosedError, tornado.iostream.StreamClosedError):
        return


def _batch(commands: Sequence[Command]) -> bytes:
    """Commands in one message, each behind its length."""
    return b"".join(struct.pack("<I", len(one)) + one for one in map(pack, commands))


def _page(robot: Robot) -> str:
    folder = resources.files("m4_dynamics.view.page")
    program, licences = viewer_program()

    def part(name: str) -> str:
        return folder.joinpath(name).read_text(encoding="utf-8")

    return Template(part("live.html")).substitute(
        title=html.escape(f"{robot.name}: live view"),
        licences=licences.replace("--", "- -"),
        style=part("scene.css"),
        viewer=program,
        script=part("scene.js") + part("live.js"),
        root=html.escape(joint_path(robot, 1)),
    )
