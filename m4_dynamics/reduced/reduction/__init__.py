"""Reduction of the full robot to the planar pendulum; the only part of `reduced` that knows robots and Pinocchio."""

from m4_dynamics.reduced.reduction.frame import BalanceFrame, balance_frame
from m4_dynamics.reduced.reduction.heading import HeadingDynamics, heading_dynamics
from m4_dynamics.reduced.reduction.holding import HoldingLoads, holding_torques, loaded_configuration
from m4_dynamics.reduced.reduction.placement import configuration_on_slope, velocity_on_slope
from m4_dynamics.reduced.reduction.projection import (
    ContactWrench,
    ProjectedModel,
    Residual,
    contact_wrench,
    project,
    residual,
    velocity_map,
)
from m4_dynamics.reduced.reduction.reduce import Reduction, reduce_robot

__all__ = [
    "BalanceFrame",
    "ContactWrench",
    "HeadingDynamics",
    "HoldingLoads",
    "ProjectedModel",
    "Reduction",
    "Residual",
    "balance_frame",
    "configuration_on_slope",
    "contact_wrench",
    "heading_dynamics",
    "holding_torques",
    "loaded_configuration",
    "project",
    "reduce_robot",
    "residual",
    "velocity_map",
    "velocity_on_slope",
]
