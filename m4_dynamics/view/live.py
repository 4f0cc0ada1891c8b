"""A run in the browser as it happens: a small server in threads of this process, which end with it.

The page is meshcat's viewer. It gets the scene once and then a frame of transforms at a time; a viewer that is slow
misses frames, the simulation never waits for one.
"""

from __future__ import annotations

import asyncio
import json
import struct
import threading
import time
from collections.abc import Sequence
from importlib import resources
from string import Template
from types import TracebackType
from typing import Any, Self

import numpy as np
import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.robot.robot import Robot
from m4_dynamics.simulation.plant import Plant
from m4_dynamics.view.arrows import round_scale
from m4_dynamics.view.bodies import joint_path
from m4_dynamics.view.frames import Frames, thrusts_in_world
from m4_dynamics.view.ground import clip_profile
from m4_dynamics.view.offline_page import viewer_program
from m4_dynamics.view.overlays import Overlays
from m4_dynamics.view.scene import Bounds, placing_commands, scene_commands, scene_motions
from m4_dynamics.view.serving import LOOPBACK
from m4_dynamics.view.three import Command, pack

__all__ = ["LiveView"]

_FRAMES_PER_SECOND = 30.0
_GROUND_REACH = 8.0  # [m] of ground shown about the start
_LAST_WORDS = 0.3  # [s] that the server gets to say that the run has ended


class LiveView:
    """Shows a plant in browsers and holds the simulation to real time; use it as a context manager."""

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
        #: What the robot is doing, in words; shown from the next frame on.
        self.phase = ""
        self._robot = robot
        self._scene: bytes | None = None
        self._overlays: Overlays | None = None
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

    def observe(self, plant: Plant) -> None:
        """Show the plant, and wait until real time has caught up with it.

        Args:
            plant: The plant after a control period; it is only read.
        """
        if self._overlays is None or self._started is None:
            self._started = time.monotonic() - plant.time
            self._overlays = self._set_up(plant)
        if plant.time >= self._next:
            self._next = plant.time + 1.0 / _FRAMES_PER_SECOND
            self._send(
                self._frame(plant, self._overlays),
                json.dumps({"time": round(plant.time, 3), "facts": self._facts(plant)}),
            )
        ahead = self._started + plant.time - time.monotonic()
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
        if self._scene is not None:
            client.give(self._scene)
        self._connected.set()

    def forget(self, client: _Channel) -> None:
        """Send a viewer nothing any more; called on the server's thread."""
        self._clients.discard(client)

    def _send(self, frame: bytes, words: str) -> None:
        self._loop.call_soon_threadsafe(self._broadcast, frame, words)

    def _broadcast(self, frame: bytes, words: str) -> None:
        for client in list(self._clients):
            client.offer(frame, words)

    def _set_up(self, plant: Plant) -> Overlays:
        """Build the scene about the place where the robot stands."""
        robot, terrain = self._robot, plant.model.terrain
        place = plant.stepper.configuration[:3]
        profile = clip_profile(
            terrain.profile_in_world[:, 0],
            terrain.profile_in_world[:, 1],
            low=float(place[0]) - _GROUND_REACH,
            high=float(place[0]) + _GROUND_REACH,
        )
        overlays = Overlays(friction=plant.model.ground.friction_static, profile=terrain.profile_in_world)
        x, y, z = (float(entry) for entry in place)
        bounds = Bounds((x - 3.0, y - 3.0, z - 3.0), (x + 3.0, y + 3.0, z + 3.0))
        commands = scene_commands(robot, profile, bounds, self._frames(plant), overlays)
        scene = _batch(commands)

        def publish() -> None:
            self._scene = scene
            for client in self._clients:
                client.give(scene)

        self._loop.call_soon_threadsafe(publish)
        return overlays

    def _frames(self, plant: Plant) -> Frames:
        """The plant as one instant."""
        robot, stepper = self._robot, plant.stepper
        configuration = np.array(stepper.configuration)[np.newaxis]
        thrusts = {
            one.frame: np.array([value]) for one, value in zip(robot.thrusters, stepper.actuation.thrust, strict=True)
        }
        com, thrust_position, thrust_force = thrusts_in_world(robot, configuration, thrusts)
        force, position = np.array(stepper.wheel_force_in_world), np.array(stepper.wheel_contact_in_world)
        return Frames(
            time=np.array([plant.time]),
            configuration=configuration,
            thrust_force=thrust_force,
            thrust_position=thrust_position,
            contact_force={one.joint: force[[k]] for k, one in enumerate(robot.wheels)},
            contact_position={one.joint: position[[k]] for k, one in enumerate(robot.wheels)},
            com=com,
        )

    def _facts(self, plant: Plant) -> list[str]:
        """Phase, slope, thrust and friction use, as text."""
        stepper = plant.stepper
        slope = plant.model.terrain.slope_at(float(stepper.configuration[0]))
        force = np.array(stepper.wheel_force_in_world)
        normal = force @ np.array([-np.sin(slope), 0.0, np.cos(slope)])
        sliding = np.sqrt(np.maximum(np.einsum("ki,ki->k", force, force) - normal**2, 0.0))
        pressed = normal > 1.0
        facts = [
            f"slope {np.degrees(slope):.0f}°",
            f"thrust {float(stepper.actuation.thrust.sum()):.1f} N",
        ]
        if pressed.any():
            use = (sliding[pressed] / (plant.model.ground.friction_static * normal[pressed])).max()
            facts.append(f"friction use {100.0 * min(float(use), 1.0):.0f} %")
        return [self.phase, *facts] if self.phase else facts

    def _frame(self, plant: Plant, overlays: Overlays) -> bytes:
        weight = self._robot.mass * self._robot.gravity
        scale = round_scale([np.array([[0.0, 0.0, weight]])])
        motions = scene_motions(self._robot, self._frames(plant), overlays, metres_per_newton=scale)
        return _batch(placing_commands(motions))


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

    def give(self, scene: bytes) -> None:
        """Send the scene."""
        self._ready = True
        self._write(scene)

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
    return Template(folder.joinpath("live.html").read_text(encoding="utf-8")).substitute(
        licences=licences.replace("--", "- -"),
        viewer=program,
        root=json.dumps(joint_path(robot, 1)),
    )
