"""A run as one self-contained page: meshcat's viewer, the scene and its animation in a file that needs no network.

The page is put together from the viewer's own program and packed commands; no server is started and no port opened.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from numpy.typing import ArrayLike

from m4_dynamics.output import replacing
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.arrows import round_scale
from m4_dynamics.view.bodies import joint_path
from m4_dynamics.view.frames import Frames, sample_frames
from m4_dynamics.view.friction import friction_use_in_plane, worst_wheel
from m4_dynamics.view.ground import TILE_LENGTH, clip_profile
from m4_dynamics.view.motion import animation_command
from m4_dynamics.view.offline_page import camera_facts, offline_page, rounded
from m4_dynamics.view.overlays import legend_entries, overlays_of
from m4_dynamics.view.phases import balancing_samples, phases_of
from m4_dynamics.view.scene import Bounds, placing_commands, scene_bounds, scene_commands, scene_motions
from m4_dynamics.view.style import run_facts

__all__ = ["replay_html", "write_replay_html"]

_GROUND_MARGIN = 0.6  # [m] of ground shown before and behind the robot's way
_FOLLOWED_FROM = 2.5  # [m] a longer way is shown by following the robot
_VIEW_DIRECTION = (-0.34, -1.0, 0.36)  # from the way's middle to the camera: beside it, a little downhill and above


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
    return offline_page(
        title=_title(dataset, robot),
        commands=commands,
        facts={
            "conditions": [fact for fact in run_facts(dataset) if not fact.startswith("mission ")],
            "labels": [],
            "legend": [asdict(entry) for entry in legend_entries(robot, overlays)],
            "scale": f"10 N: {1000.0 * metres_per_newton:.3g} cm, tiles: {100.0 * TILE_LENGTH:.3g} cm",
            "frames_per_second": frames_per_second,
            "start_time": rounded([frames.time[0]], 4)[0],
            "times": rounded(frames.elapsed, 4),
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
    return camera_facts(
        bounds.low, bounds.high, _VIEW_DIRECTION, follow=joint_path(robot, 1), following=length > _FOLLOWED_FROM
    )


def _readouts(dataset: xarray.Dataset, frames: Frames) -> list[dict[str, Any]]:
    """Figures shown beside the animation, as far as the trajectory has them."""
    time = dataset["time"].values

    def at_frames(values: ArrayLike, digits: int) -> list[float | None]:
        return rounded(np.interp(frames.time, time, np.asarray(values, dtype=float)), digits)

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
