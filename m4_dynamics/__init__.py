"""Model-based analysis of wheeled-and-thrustered robots that balance on two wheels and climb (WAIR).

The public names are loaded on first use, so that `import m4_dynamics` stays light.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

#: Public name -> module that defines it.
_PUBLIC: dict[str, str] = {
    # robot
    "Robot": "m4_dynamics.robot.robot",
    "load_robot": "m4_dynamics.robot.loading",
    # full model
    "FullModel": "m4_dynamics.full.model",
    "ExplicitStepper": "m4_dynamics.full.stepping",
    "ImplicitStepper": "m4_dynamics.full.stepping",
    "Terrain": "m4_dynamics.full.terrain",
    "flat_terrain": "m4_dynamics.full.terrain",
    "incline_terrain": "m4_dynamics.full.terrain",
    "plateau_terrain": "m4_dynamics.full.terrain",
    "ramp_terrain": "m4_dynamics.full.terrain",
    "bias_forces": "m4_dynamics.full.dynamics",
    "forward_dynamics": "m4_dynamics.full.dynamics",
    "input_map": "m4_dynamics.full.dynamics",
    "mass_matrix": "m4_dynamics.full.dynamics",
    "state_derivative": "m4_dynamics.full.dynamics",
    "thrust_map": "m4_dynamics.full.dynamics",
    "contact_jacobian": "m4_dynamics.full.contact",
    "contacts_at": "m4_dynamics.full.contact",
    "linearise_full": "m4_dynamics.full.linearisation",
    # reduced model
    "MipParameters": "m4_dynamics.reduced.pendulum",
    "linearise": "m4_dynamics.reduced.pendulum",
    "controllability": "m4_dynamics.reduced.linear",
    "ground_force_in_slope": "m4_dynamics.reduced.ground_force",
    "Reduction": "m4_dynamics.reduced.reduction",
    "configuration_on_slope": "m4_dynamics.reduced.reduction",
    "reduce_robot": "m4_dynamics.reduced.reduction",
    "Trim": "m4_dynamics.reduced.trim",
    "TrimLimits": "m4_dynamics.reduced.trim",
    "select_trim": "m4_dynamics.reduced.trim",
    "trim_branches": "m4_dynamics.reduced.trim",
    # control
    "BalanceController": "m4_dynamics.control.controller",
    "BalanceEstimator": "m4_dynamics.control.estimator",
    "DelayCompensator": "m4_dynamics.control.delay",
    "HeadingHold": "m4_dynamics.control.heading",
    "ImuErrors": "m4_dynamics.control.imu",
    "InertialEstimator": "m4_dynamics.control.inertial",
    "LqrController": "m4_dynamics.control.lqr",
    "MpcController": "m4_dynamics.control.mpc.controller",
    "MpcSettings": "m4_dynamics.control.mpc.settings",
    "PidController": "m4_dynamics.control.pid",
    "ReferenceTrajectory": "m4_dynamics.control.reference",
    "climb_reference": "m4_dynamics.control.reference",
    # simulation
    "Battery": "m4_dynamics.simulation.battery",
    "ClimbSettings": "m4_dynamics.simulation.climb",
    "Plant": "m4_dynamics.simulation.plant",
    "Fidelity": "m4_dynamics.simulation.fidelity",
    "load_trajectory": "m4_dynamics.simulation.trajectory",
    "prepare_climb": "m4_dynamics.simulation.climb",
    "run_climb": "m4_dynamics.simulation.climb",
    "run_climbs": "m4_dynamics.simulation.batch",
    "save_trajectory": "m4_dynamics.simulation.trajectory",
    # missions
    "Mission": "m4_dynamics.mission.schema",
    "load_mission": "m4_dynamics.mission.loading",
    "run_mission": "m4_dynamics.mission.runner",
    # view
    "plot_ground_forces": "m4_dynamics.view.plots",
    "plot_states": "m4_dynamics.view.plots",
    "write_replay_html": "m4_dynamics.view.replay",
    # errors
    "M4Error": "m4_dynamics.errors",
    "NoTrimExists": "m4_dynamics.errors",
}

__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'm4_dynamics' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
