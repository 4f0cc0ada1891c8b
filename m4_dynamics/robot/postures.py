"""Postures from an SRDF file.

Pinocchio's own reader skips unknown joints and malformed values silently; this one names them.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.errors import RobotDescriptionError, UnknownNameError
from m4_dynamics.robot.robot import Posture

__all__ = ["read_postures"]


def read_postures(model: pin.Model, srdf: Path) -> dict[str, Posture]:
    """Read the group states of an SRDF file.

    Args:
        model: The robot's model, on a free-flyer root.
        srdf: The file.

    Returns:
        Name -> posture, in the file's order; joints that a posture does not name stand at their neutral angle.

    Raises:
        RobotDescriptionError: If the file is missing or malformed, or a value is not a finite number.
        UnknownNameError: If a posture names a joint that the model does not have.
    """
    try:
        root = ET.parse(srdf).getroot()
    except FileNotFoundError as error:
        raise RobotDescriptionError(f"{srdf}: no such file; expected the robot's SRDF") from error
    except (ET.ParseError, OSError) as error:
        raise RobotDescriptionError(f"{srdf}: not valid XML: {error}") from error
    postures: dict[str, Posture] = {}
    for state in root.iter("group_state"):
        name = state.get("name")
        if not name:
            raise RobotDescriptionError(f"{srdf}: a group_state has no name")
        if name in postures:
            raise RobotDescriptionError(f"{srdf}: two group_states are called '{name}'")
        configuration = _configuration(model, state, f"{srdf}: posture '{name}'")
        postures[name] = Posture(name=name, configuration=configuration)
    return postures


def _configuration(model: pin.Model, state: ET.Element, where: str) -> NDArray[np.float64]:
    configuration: NDArray[np.float64] = pin.neutral(model)
    for element in state.iter("joint"):
        name = element.get("name") or ""
        if not model.existJointName(name):
            raise UnknownNameError("joint", name, list(model.names)[2:], where=where)
        joint_id = model.getJointId(name)
        if joint_id == 1:
            continue  # the pose of the root is not part of a posture
        joint = model.joints[joint_id]
        if joint.nv != 1:
            raise RobotDescriptionError(f"{where}: joint '{name}' has {joint.nv} degrees of freedom, not one")
        value = _finite(element.get("value"), f"{where}: joint '{name}'")
        if joint.nq == 2:
            configuration[joint.idx_q : joint.idx_q + 2] = (math.cos(value), math.sin(value))
        else:
            configuration[joint.idx_q] = value
    configuration.setflags(write=False)
    return configuration


def _finite(text: str | None, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RobotDescriptionError(f"{where} must have a finite number as its value, got {text!r}")
    return value
