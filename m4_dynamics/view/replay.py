"""A run as one self-contained page: meshcat's viewer, the scene and its animation in a file that needs no network.

The page is put together from the viewer's own program and packed commands; no server is started and no port opened.
"""

from __future__ import annotations

import base64
import html
import importlib.util
import json
from collections.abc import Sequence
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import xarray
from numpy.typing import ArrayLike

from m4_dynamics.errors import ResultFileError
from m4_dynamics.output import replacing
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import round_scale
from m4_dynamics.view.bodies import joint_path
from m4_dynamics.view.frames import Frames, sample_frames
from m4_dynamics.view.friction import friction_use_in_plane, worst_wheel
from m4_dynamics.view.ground import TILE_LENGTH, clip_profile
from m4_dynamics.view.motion import animation_command
from m4_dynamics.view.overlays import legend_entries, overlays_of
from m4_dynamics.view.phases import balancing_samples, phases_of
from m4_dynamics.view.scene import Bounds, placing_commands, scene_bounds, scene_commands, scene_motions
from m4_dynamics.view.style import run_facts
from m4_dynamics.view.three import Command, pack_in_parts

__all__ = ["replay_html", "write_replay_html"]

_GROUND_MARGIN = 0.6  # [m] of ground shown before and behind the robot's way
_FOLLOWED_FROM = 2.5  # [m] a longer way is shown by following the robot
_VIEW_DIRECTION = (-0.34, -1.0, 0.36)  # from the way's middle to the camera: beside it, a little downhill and above
_FIELD_OF_VIEW = 30.0  # [deg] vertical
# Nothing may be fetched from anywhere; what runs is in the page.
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def write_replay_html(
    dataset: xarray.Dataset, robot: Robot, path: Path | str, *, frames_per_second: float = 30.0
) -> Path:
    """Write the replay of a run as one offline page.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        path: The page's file.
        frames_per_second: Rate of the animation's key frames [1/s]; the viewer interpolates between them.

    Returns:
        The path.

    Raises:
        InvalidSettingError: The rate is not valid.
        ResultFileError: The trajectory cannot be shown with this robot, or the file cannot be written.
    """
    target = Path(path)
    page = replay_html(dataset, robot, frames_per_second=frames_per_second)
    with replacing(target) as partial:
        partial.write_text(page, encoding="utf-8")
    return target


def replay_html(dataset: xarray.Dataset, robot: Robot, *, frames_per_second: float = 30.0) -> str:
    """The replay of a run as the text of one offline page.

    Args:
        dataset: A trajectory.
        robot: The robot that made it.
        frames_per_second: Rate of the animation's key frames [1/s].

    Returns:
        The page. The same trajectory gives the same text.

    Raises:
        InvalidSettingError: The rate is not valid.
        ResultFileError: The trajectory cannot be shown with this robot.
    """
    frames = sample_frames(dataset, robot, frames_per_second=frames_per_second)
    metres_per_newton = round_scale([*frames.contact_force.values(), *frames.thrust_force.values()])
    overlays = overlays_of(dataset, robot, frames)
    motions = scene_motions(robot, frames, overlays, metres_per_newton=metres_per_newton)
    bounds = scene_bounds(motions, robot)
    profile = clip_profile(
        dataset["terrain_x"].values,
        dataset["terrain_z"].values,
        low=bounds.low[0] - _GROUND_MARGIN,
        high=bounds.high[0] + _GROUND_MARGIN,
    )
    commands = scene_commands(robot, profile, bounds, frames, overlays)
    commands += placing_commands(motions)
    commands.append(animation_command(motions, frames.elapsed, frames_per_second))
    return _page(
        title=_title(dataset, robot),
        commands=commands,
        facts={
            "conditions": [fact for fact in run_facts(dataset) if not fact.startswith("mission ")],
            "legend": [asdict(entry) for entry in legend_entries(robot, overlays)],
            "scale": f"10 N: {1000.0 * metres_per_newton:.3g} cm, tiles: {100.0 * TILE_LENGTH:.3g} cm",
            "frames_per_second": frames_per_second,
            "start_time": _rounded([frames.time[0]], 4)[0],
            "times": _rounded(frames.elapsed, 4),
            "readouts": _readouts(dataset, frames),
            "phases": _phases(dataset, frames),
            "camera": _camera(robot, bounds),
        },
    )


def _title(dataset: xarray.Dataset, robot: Robot) -> str:
    slope = float(dataset.attrs.get("slope_deg", 0.0))
    if dataset.attrs.get("mission"):
        return f"{robot.name}: mission {dataset.attrs['mission']}"
    return f"{robot.name} on a {slope:g}° slope" if slope else robot.name


def _phases(dataset: xarray.Dataset, frames: Frames) -> list[dict[str, Any]]:
    """The phases of a mission, their times counted from the first frame."""
    return [
        {
            "label": phase.label,
            "colour": phase.colour,
            "start": round(phase.start - float(frames.time[0]), 4),
            "end": round(phase.end - float(frames.time[0]), 4),
        }
        for phase in phases_of(dataset)
    ]


def _camera(robot: Robot, bounds: Bounds) -> dict[str, Any]:
    length = float(np.linalg.norm(np.subtract(bounds.high, bounds.low)))
    return {
        "low": _rounded(bounds.low, 3),
        "high": _rounded(bounds.high, 3),
        "direction": _VIEW_DIRECTION,
        "field_of_view": _FIELD_OF_VIEW,
        "follow": length > _FOLLOWED_FROM,
        "root": joint_path(robot, 1),
    }


def _readouts(dataset: xarray.Dataset, frames: Frames) -> list[dict[str, Any]]:
    """Figures shown beside the animation, as far as the trajectory has them."""
    time = dataset["time"].values

    def at_frames(values: ArrayLike, digits: int) -> list[float | None]:
        return _rounded(np.interp(frames.time, time, np.asarray(values, dtype=float)), digits)

    readouts: list[dict[str, Any]] = []

    def show(label: str, unit: str, digits: int, values: ArrayLike) -> None:
        readouts.append({"label": label, "unit": unit, "digits": digits, "values": at_frames(values, digits + 1)})

    balancing = balancing_samples(dataset)
    if "travel" in dataset and phases_of(dataset):
        show(
            "way along the ground" if not dataset.attrs.get("slope_deg") else "way from the foot",
            "m",
            2,
            dataset.travel,
        )
        show("ground", "°", 0, np.rad2deg(dataset["slope"].values))
    elif "axle_position_in_world" in dataset:
        axle = dataset["axle_position_in_world"].values
        show("distance", "m", 2, np.linalg.norm(axle - axle[0], axis=1))
    if "state" in dataset:
        show("pitch", "°", 1, np.rad2deg(dataset["state"].values[:, 1]))
    show("thrust", "N", 1, dataset["thrust"].sum("thruster").values)
    if "ground_force_simulated" in dataset and "friction_static" in dataset.attrs:
        force = np.asarray(dataset["ground_force_simulated"].values, dtype=float)
        use = friction_use_in_plane(force, float(dataset.attrs["friction_static"]))
        show("friction use", "%", 0, np.where(balancing, 100.0 * use, np.nan))
    if "friction_use" in dataset:
        # Wheels on legs also press against each other, which drives a robot nowhere.
        use = worst_wheel(np.asarray(dataset["friction_use"].values, dtype=float))
        show("with sideways", "%", 0, np.where(balancing, 100.0 * use, np.nan))
    return readouts


def _rounded(values: ArrayLike, digits: int) -> list[float | None]:
    """Numbers for JSON, which has no NaN: those become null."""
    return [
        round(float(one), digits) if np.isfinite(one) else None for one in np.ravel(np.asarray(values, dtype=float))
    ]


def _page(*, title: str, commands: Sequence[Command], facts: dict[str, Any]) -> str:
    """Put the page together."""
    folder = resources.files("m4_dynamics.view.page")
    # A mesh that four wheels share, and the instants that all tracks share, are written once.
    numbers: dict[bytes, int] = {}
    packed = [[numbers.setdefault(part, len(numbers)) for part in pack_in_parts(one)] for one in commands]
    parts = [base64.b64encode(part).decode("ascii") for part in numbers]
    content = {"parts": parts, "commands": packed, **facts}
    data = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    program, licences = _viewer_program()
    return Template(folder.joinpath("replay.html").read_text(encoding="utf-8")).substitute(
        title=html.escape(title),
        policy=_POLICY,
        licences=licences.replace("--", "- -"),
        style=folder.joinpath("replay.css").read_text(encoding="utf-8"),
        viewer=program,
        # Inside a script element only "</" could end the data early.
        data=data.replace("</", "<\\/"),
        script=folder.joinpath("replay.js").read_text(encoding="utf-8"),
    )


def _viewer_program() -> tuple[str, str]:
    """The text of meshcat's viewer and its licences; the package is found without importing it, which is slow."""
    package = importlib.util.find_spec("meshcat")
    if package is None or not package.submodule_search_locations:
        raise ResultFileError("the replay page needs the Python package meshcat, which is not installed")
    viewer = Path(package.submodule_search_locations[0]) / "viewer"
    try:
        program = (viewer / "dist" / "main.min.js").read_text(encoding="utf-8")
        licences = [
            (viewer / name).read_text(encoding="utf-8").strip() for name in ("LICENSE", "dist/main.min.js.LICENSE.txt")
        ]
    except OSError as error:
        raise ResultFileError(f"meshcat's viewer cannot be read: {error}") from error
    return program.replace("</script", "<\\/script"), "meshcat viewer\n\n" + "\n\n".join(licences)
