"""A robot's reduction to the pendulum as plain values and as tables; degrees here, radians everywhere below."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.table import Table

from m4_dynamics.errors import NoTrimExists
from m4_dynamics.reduced.pendulum import MipParameters, controllability, linearise
from m4_dynamics.reduced.reduction import (
    Reduction,
    heading_dynamics,
    holding_torques,
    loaded_configuration,
    reduce_robot,
)
from m4_dynamics.reduced.trim import Trim, select_trim
from m4_dynamics.robot.robot import Robot
from m4_dynamics.view.tables import cell, make_table

__all__ = ["describe_reduction", "reduction_tables"]

#: Attribute of `MipParameters` -> symbol of the paper, unit, meaning.
_PARAMETERS = {
    "mass_body": ("m_b", "kg", "everything but the drive wheels"),
    "mass_wheel": ("m_w", "kg", "both drive wheels"),
    "inertia_body": ("I_b", "kg m2", "body about its CoM, lateral axis"),
    "inertia_wheel": ("I_w", "kg m2", "both drive wheels about the axle"),
    "com_in_body": ("l_b", "m", "CoM of the body from the axle (forward, up)"),
    "thrust_point_in_body": ("l_t", "m", "centre of thrust from the axle (forward, up)"),
    "wheel_radius": ("r", "m", ""),
    "torque_constant": ("k1", "N m", "torque of both motors at full duty and standstill"),
    "back_emf_constant": ("k2", "N m s", "torque lost per wheel rate, both motors"),
    "gravity": ("g", "m/s2", ""),
    "thrust_time_constant": ("T", "s", "first-order lag of the thrust"),
}


def describe_reduction(robot: Robot, reduction: Reduction, slope: float) -> dict[str, Any]:
    """A reduction as values that JSON can hold.

    Args:
        robot: The robot.
        reduction: Its reduction.
        slope: Inclination on which legs, heading and controllability are looked at, at the automatic trim [rad].

    Returns:
        The pendulum's parameters by their names, `residual`, the axes, and under `on_slope` what depends on the slope
        (with `no_trim` instead if the robot cannot stand there).
    """
    frame = reduction.frame
    outline = reduction.outline_in_body
    return {
        "robot": robot.name,
        "posture": reduction.posture,
        **_parameter_values(reduction.parameters),
        "residual": {"in_plane": reduction.residual_in_plane, "out_of_plane": reduction.residual_out_of_plane},
        "com_lateral": reduction.com_lateral,
        "thrust_max": reduction.thrust_max,
        "frame": {
            "forward_in_base": frame.forward_in_base.tolist(),
            "lateral_in_base": frame.lateral_in_base.tolist(),
            "up_in_base": frame.up_in_base.tolist(),
            "axle_in_base": frame.axle_in_base.tolist(),
            "track": frame.track,
            "drive_wheels": [
                {"joint": joint, "sign": float(sign), "lateral_position": float(offset)}
                for joint, sign, offset in zip(frame.wheel_joints, frame.wheel_signs, frame.wheel_offsets, strict=True)
            ],
            "thrusters": [
                {"frame": thruster.frame, "share": float(share)}
                for thruster, share in zip(robot.thrusters, reduction.thrust_shares, strict=True)
                if share > 0.0
            ],
        },
        "outline_in_body": None if outline is None else outline.tolist(),
        "on_slope": _on_slope(robot, reduction, slope),
    }


def reduction_tables(description: Mapping[str, Any]) -> list[Table]:
    """Tables of a description from `describe_reduction`."""
    loaded = description["on_slope"].get("loaded", {})
    parameters = [
        [symbol, name, _vector(description[name]), unit, _vector(loaded[name]) if loaded else "-", meaning]
        for name, (symbol, unit, meaning) in _PARAMETERS.items()
    ]
    frame, residual = description["frame"], description["residual"]
    forward = "thrust pushes along it" if description["thrust_max"] > 0.0 else "the way it drives"
    axes = [
        ["forward", _vector(frame["forward_in_base"]), forward],
        ["lateral (left)", _vector(frame["lateral_in_base"]), "pitch and wheel angle are positive about it"],
        ["up", _vector(frame["up_in_base"]), ""],
        ["axle midpoint [m]", _vector(frame["axle_in_base"]), f"track {cell(frame['track'])} m"],
    ]
    wheels = [[w["joint"], w["sign"], 1e3 * w["lateral_position"]] for w in frame["drive_wheels"]]
    agreement = [
        ["in plane", f"{residual['in_plane']:.1e}", "mass matrix, bias and input map against the projected full model"],
        ["out of plane", f"{residual['out_of_plane']:.1e}", "side force, roll and yaw moment left for the contacts"],
        [
            "CoM off the sagittal plane",
            f"{cell(round(1e3 * description['com_lateral'], 9))} mm",
            "positive to the left",
        ],
    ]
    title = f"Pendulum of {description['robot']} in posture '{description['posture']}'"
    columns = ["symbol", "parameter", "value", "unit", "legs loaded", "meaning"]
    tables = [
        make_table(title, columns, parameters),
        make_table("Axes in the base frame", ["axis", "direction", ""], axes),
        make_table("Drive wheels", ["joint", "sign of its axis", "lateral position [mm]"], wheels),
        make_table("Residual against the full model, relative", ["part", "worst", "of what"], agreement),
    ]
    on_slope = description["on_slope"]
    if "no_trim" not in on_slope:
        tables += _slope_tables(on_slope)
    return tables


def _parameter_values(parameters: MipParameters) -> dict[str, Any]:
    return {name: _plain(getattr(parameters, name)) for name in _PARAMETERS}


def _on_slope(robot: Robot, reduction: Reduction, slope: float) -> dict[str, Any]:
    limits = reduction.trim_limits(friction_static=robot.ground.friction_static)
    try:
        trim = select_trim(reduction.parameters, slope, limits=limits)
    except NoTrimExists as refusal:
        return {"slope_deg": math.degrees(slope), "no_trim": str(refusal)}
    heading = heading_dynamics(robot, reduction, slope=slope, pitch=trim.pitch)
    loads = holding_torques(robot, reduction, trim)
    loaded = reduce_robot(robot, reduction.posture, configuration=loaded_configuration(robot, reduction, loads))
    return {
        "slope_deg": math.degrees(slope),
        "pitch_deg": math.degrees(trim.pitch),
        "thrust_N": trim.thrust,
        "heading": {**heading._asdict(), "growth_rate": heading.growth_rate},
        "controllability": _controllability(reduction, trim),
        "holding": [
            {
                "joint": servo.joint,
                "torque_Nm": float(torque),
                "share_of_limit": float(abs(torque) / servo.effort_limit) if servo.effort_limit > 0.0 else None,
                "sag_deg": math.degrees(float(sag)),
            }
            for servo, torque, sag in zip(robot.servos, loads.torques, loads.sag, strict=True)
        ],
        "loaded": _parameter_values(loaded.parameters),
    }


def _controllability(reduction: Reduction, trim: Trim) -> dict[str, Any]:
    """Of the linearised pendulum, with the inputs that the robot has."""
    a, b = linearise(reduction.parameters, trim.slope, trim.state, trim.inputs)
    result = controllability(a, b if reduction.thrust_max > 0.0 else b[:, :1])
    poles = np.linalg.eigvals(a)
    return {
        "rank": result.rank,
        "states": len(a),
        "smallest_singular_value": result.smallest_singular_value,
        "fastest_unstable_pole": float(poles.real.max()),
    }


def _slope_tables(on_slope: Mapping[str, Any]) -> list[Table]:
    where = f"on {on_slope['slope_deg']:g} deg at {on_slope['thrust_N']:.1f} N, pitch {on_slope['pitch_deg']:.1f} deg"
    heading, control = on_slope["heading"], on_slope["controllability"]
    dynamics = [
        ["controllable", f"rank {control['rank']} of {control['states']}", ""],
        ["smallest singular value", control["smallest_singular_value"], ""],
        ["fastest unstable pole", control["fastest_unstable_pole"], "1/s"],
        ["yaw inertia about the slope normal", heading["yaw_inertia"], "kg m2"],
        ["gravity's turning stiffness", heading["gravity_stiffness"], "N m/rad"],
        ["yaw damping", heading["damping"], "N m s/rad"],
        ["growth of a heading error", heading["growth_rate"], "1/s"],
    ]
    tables = [make_table(f"Balance and heading {where}", ["", "value", "unit"], dynamics)]
    if on_slope["holding"]:
        columns = ["servo", "torque [N m]", "share of its limit", "sag [deg]"]
        rows = [[h["joint"], h["torque_Nm"], h["share_of_limit"], h["sag_deg"]] for h in on_slope["holding"]]
        tables.append(make_table(f"What the legs hold {where}", columns, rows))
    return tables


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _vector(value: Any) -> Any:
    """Numbers side by side; rounding noise of an axis shows as 0."""
    if not isinstance(value, list):
        return value
    return "  ".join(cell(0.0 if abs(entry) < 1e-12 else float(entry)) for entry in value)
