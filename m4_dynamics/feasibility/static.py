"""Static maps: the closed-form equilibria over slope, thrust, friction, speed and posture, with what limits them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import InvalidSettingError
from m4_dynamics.feasibility.grid import AXIS_UNITS, MapGrid
from m4_dynamics.feasibility.limits import Limit, limit_meanings
from m4_dynamics.reduced.equilibrium import BRANCHES, equilibrium_loads, equilibrium_pitches
from m4_dynamics.reduced.pendulum import MipParameters
from m4_dynamics.reduced.power import PowerModel, power_needed
from m4_dynamics.reduced.trim_limits import TrimLimits, trim_margins

if TYPE_CHECKING:
    import xarray

__all__ = ["PostureCase", "best_branch", "static_map"]

_Array = NDArray[np.float64]

#: Slopes handled at a time are so many that the intermediate arrays stay in the processor's cache.
_BLOCK_CELLS = 16_384
#: Margins are satisfied to rounding, as those of a single trim are.
_ROUNDING = 1e-9

#: Variable -> (dimensions besides the branch, unit, meaning).
_VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "pitch": (("posture_angle", "slope", "thrust"), "rad", "body pitch from upright in the world"),
    "torque": (("posture_angle", "slope", "thrust"), "N m", "torque of both motors"),
    "friction_force": (("posture_angle", "slope", "thrust"), "N", "force of the ground along the slope, uphill"),
    "normal_force": (("posture_angle", "slope", "thrust"), "N", "normal force of the ground"),
    "friction_needed": (("posture_angle", "slope", "thrust"), "1", "friction coefficient needed"),
    "duty": (("posture_angle", "speed", "slope", "thrust"), "1", "motor duty, not limited"),
    "power": (("posture_angle", "speed", "slope", "thrust"), "W", "electric power of rotors and wheel motors"),
    "margin_friction": (("posture_angle", "friction", "slope", "thrust"), "1", "friction coefficient to spare"),
    "margin_normal_force": (("posture_angle", "slope", "thrust"), "N", "above the least normal force"),
    "margin_torque": (("posture_angle", "slope", "thrust"), "N m", "below the motors' torque at standstill"),
    "margin_motor_speed": (
        ("posture_angle", "speed", "slope", "thrust"),
        "rad/s",
        "wheel speed to spare at this torque before the duty saturates",
    ),
    "margin_clearance": (("posture_angle", "slope", "thrust"), "m", "above the least ground clearance"),
    "margin_pitch_window": (("posture_angle", "slope", "thrust"), "rad", "inside the pitch window"),
}


@dataclass(frozen=True, slots=True, eq=False)
class PostureCase:
    """The robot in one posture, as far as a static map needs it.

    Attributes:
        parameters: The pendulum.
        limits: Its limits; their friction is replaced by the map's axis.
        collides: Whether bodies of the robot overlap.
    """

    parameters: MipParameters
    limits: TrimLimits
    collides: bool = False


def static_map(cases: Sequence[PostureCase], grid: MapGrid, *, power_model: PowerModel | None = None) -> xarray.Dataset:
    """Compute both branches of the equilibria in every cell, with margins and the active limit.

    Args:
        cases: One for each value of the grid's posture angle.
        grid: The axes.
        power_model: Rotor figures; None takes the defaults.

    Returns:
        The map. Every variable has the dimensions it depends on, of (branch, posture_angle, speed, friction, slope,
        thrust), and the attributes `units` and `long_name`. NaN: no equilibrium. `feasible`: all limits hold.
        `active_limit`: a code of `Limit`, see there.

    Raises:
        InvalidSettingError: There is not one posture for each posture angle.
    """
    import xarray

    axes = grid.axes
    sizes = {"branch": len(BRANCHES), **dict(zip(axes, grid.shape, strict=True))}
    if len(cases) != sizes["posture_angle"]:
        raise InvalidSettingError("postures", len(cases), f"one for each posture angle, {sizes['posture_angle']}")
    power = PowerModel() if power_model is None else power_model
    arrays = {
        name: np.empty([sizes[d] for d in ("branch", *dimensions)]) for name, (dimensions, *_) in _VARIABLES.items()
    }
    everything = ("branch", *AXIS_UNITS)
    active = np.empty([sizes[d] for d in everything], dtype=np.int8)
    feasible = np.empty(active.shape, dtype=bool)
    rows = max(1, _BLOCK_CELLS // sizes["thrust"])
    for p, case in enumerate(cases):
        for start in range(0, sizes["slope"], rows):
            block = slice(start, start + rows)
            _fill_block(case, grid, power, p, block, arrays, active, feasible)

    variables: dict[str, Any] = {
        name: (("branch", *dimensions), arrays[name], {"units": unit, "long_name": meaning})
        for name, (dimensions, unit, meaning) in _VARIABLES.items()
    }
    low, high = cases[0].limits.thrust_range
    variables["margin_thrust"] = (
        ("thrust",),
        np.minimum(axes["thrust"] - low, high - axes["thrust"]),
        {"units": "N", "long_name": "to the nearer bound of the thrust"},
    )
    variables["self_collision"] = (
        ("posture_angle",),
        np.array([case.collides for case in cases]),
        {"units": "1", "long_name": "bodies of the robot overlap"},
    )
    variables["feasible"] = (everything, feasible, {"units": "1", "long_name": "all limits hold"})
    variables["active_limit"] = (
        everything,
        active,
        {
            "units": "1",
            "long_name": "limit with the smallest margin relative to its natural size",
            "flag_values": [int(limit) for limit in Limit],
            "flag_meanings": limit_meanings(),
        },
    )
    coordinates: dict[str, Any] = {
        name: ((name,), values, {"units": AXIS_UNITS[name][0], "long_name": AXIS_UNITS[name][1]})
        for name, values in axes.items()
    }
    coordinates["branch"] = (("branch",), list(BRANCHES), {"long_name": "solution of the pitch condition"})
    return xarray.Dataset(variables, coordinates, {"kind": "static", "posture_joints": list(grid.posture_joints)})


def best_branch(dataset: xarray.Dataset) -> xarray.Dataset:
    """One branch for each cell: of the feasible ones the one that needs less friction, else the upright one.

    Args:
        dataset: A static map.

    Returns:
        The map without the dimension `branch`; where no branch is feasible, the upright one's figures.
    """
    needed = dataset["friction_needed"].fillna(np.inf)
    rank = needed.where(dataset["feasible"], np.inf)
    choice = rank.argmin("branch").compute()
    return dataset.isel(branch=choice).drop_vars("branch")


def _fill_block(
    case: PostureCase,
    grid: MapGrid,
    power: PowerModel,
    p: int,
    block: slice,
    arrays: dict[str, _Array],
    active: NDArray[np.int8],
    feasible: NDArray[np.bool_],
) -> None:
    """Fill some slopes of one posture."""
    parameters, limits = case.parameters, case.limits
    axes = grid.axes
    slope, thrust = axes["slope"][block, None], axes["thrust"][None, :]
    pitch = equilibrium_pitches(parameters, slope, thrust)
    missing = np.isnan(pitch)
    loads = equilibrium_loads(parameters, slope, thrust, pitch)
    margins = trim_margins(limits, slope, thrust, pitch, loads, parameters.wheel_radius)
    full_torque = parameters.torque_constant * limits.duty_max
    torque_margin = full_torque - np.abs(loads.torque)
    # `loads` are those of zero speed and the limits' own friction: what depends on either is done anew below.
    for name, values in (
        ("pitch", pitch),
        ("torque", loads.torque),
        ("friction_force", loads.friction_force),
        ("normal_force", loads.normal_force),
        ("friction_needed", loads.friction_needed),
        ("margin_normal_force", margins.normal_force),
        ("margin_torque", torque_margin),
        ("margin_clearance", margins.clearance),
        ("margin_pitch_window", margins.pitch_window),
    ):
        arrays[name][:, p, block] = values

    relative: dict[Limit, Any] = {
        Limit.NORMAL_FORCE: margins.normal_force / parameters.weight,
        Limit.THRUST: np.asarray(margins.thrust) / max(limits.thrust_range[1], 0.1 * parameters.weight),
        Limit.TORQUE: torque_margin / full_torque,
        Limit.CLEARANCE: np.asarray(margins.clearance) / parameters.wheel_radius,
        Limit.PITCH_WINDOW: margins.pitch_window,
    }
    fixed, fixed_code = _smallest(relative, pitch.shape)
    torque_missed = torque_margin < -_ROUNDING
    for s, speed in enumerate(axes["speed"]):
        wheel_rate = speed / parameters.wheel_radius
        back_emf = parameters.back_emf_constant * wheel_rate
        duty = (loads.torque + back_emf) / parameters.torque_constant
        arrays["duty"][:, p, s, block] = duty
        arrays["power"][:, p, s, block] = power_needed(parameters, power, thrust, loads.torque, wheel_rate)
        duty_margin = limits.duty_max - np.abs(duty)
        speed_scale = (
            parameters.torque_constant / parameters.back_emf_constant if parameters.back_emf_constant > 0.0 else np.inf
        )
        arrays["margin_motor_speed"][:, p, s, block] = duty_margin * speed_scale
        worst, code = fixed, fixed_code
        if speed != 0.0:
            # At standstill the duty says what the torque says already.
            limited = np.where(torque_missed, np.inf, duty_margin / limits.duty_max)
            worst, code = _smaller(worst, code, limited, Limit.MOTOR_SPEED)
        for m, friction in enumerate(axes["friction"]):
            margin = friction - loads.friction_needed
            arrays["margin_friction"][:, p, m, block] = margin
            # Where the ground would have to pull, the friction needed is infinite, and the normal force says so.
            with np.errstate(invalid="ignore"):
                limited = np.where(np.isneginf(margin), np.inf, margin / friction)
            least, names = _smaller(worst, code, limited, Limit.FRICTION)
            allowed = (least >= -_ROUNDING) & ~missing
            if case.collides:
                allowed, names = np.zeros_like(allowed), np.full_like(names, Limit.COLLISION)
            feasible[:, p, s, m, block] = allowed
            active[:, p, s, m, block] = np.where(missing, np.int8(Limit.EQUILIBRIUM), names)


def _smallest(relative: dict[Limit, Any], shape: tuple[int, ...]) -> tuple[_Array, NDArray[np.int8]]:
    """The smallest of several margins in every cell, and whose it is; without meaning where a margin is NaN."""
    worst, code = np.full(shape, np.inf), np.zeros(shape, dtype=np.int8)
    for limit, margin in relative.items():
        worst, code = _smaller(worst, code, margin, limit)
    return worst, code


def _smaller(worst: _Array, code: NDArray[np.int8], margin: Any, limit: Limit) -> tuple[_Array, NDArray[np.int8]]:
    smaller = margin < worst
    return np.where(smaller, margin, worst), np.where(smaller, np.int8(limit), code)
