"""The figures of a map's cells as text, for the page's pointer."""

from __future__ import annotations

import numpy as np
import xarray

from m4_dynamics.feasibility.disagreement import EFFECT_LABELS, Effect
from m4_dynamics.view.map_layers import MapLayout

__all__ = ["hover_text"]

#: Figure -> (label, factor, format); those that a map does not have are left out.
_TEXT = {
    "pitch": ("pitch [deg]", 180.0 / np.pi, ".1f"),
    "duty": ("duty", 1.0, ".2f"),
    "friction_force": ("friction force [N]", 1.0, ".1f"),
    "normal_force": ("normal force [N]", 1.0, ".1f"),
    "friction_needed": ("friction needed", 1.0, ".3f"),
    "power": ("power [W]", 1.0, ".0f"),
    "margin_torque": ("torque to spare [N m]", 1.0, ".2f"),
    "margin_motor_speed": ("wheel speed to spare [rad/s]", 1.0, ".1f"),
    "margin_clearance": ("clearance to spare [m]", 1.0, ".3f"),
    "settling_time": ("back after [s]", 1.0, ".2f"),
    "pitch_excursion": ("farthest pitch [deg]", 180.0 / np.pi, ".1f"),
    "axle_excursion": ("farthest axle [m]", 1.0, ".2f"),
    "slip_time": ("slip [s]", 1.0, ".2f"),
    "climbed": ("climbed [m]", 1.0, ".2f"),
    "wheel_rms": ("wheel error, RMS [m]", 1.0, ".3f"),
    "duty_saturated": ("at full duty [s]", 1.0, ".2f"),
    "solver_failures": ("solver failures", 1.0, ".0f"),
    "friction_used": ("friction used", 1.0, ".2f"),
}


def hover_text(one: xarray.Dataset, layout: MapLayout) -> np.ndarray:
    """Put the figures of every cell into words.

    Args:
        one: The cells of one sheet.
        layout: Of the page.

    Returns:
        Lines with simple markup, shape (y, x).
    """
    over, across = layout.y.name, layout.x.name
    x, y = (axis.factor * one[axis.name].to_numpy() for axis in (layout.x, layout.y))
    names = one.attrs["classes"]
    classes = one["class"].transpose(over, across).to_numpy()
    figures = []
    for name, (label, factor, form) in _TEXT.items():
        if name not in one:
            continue
        values = one[name]
        if "start" in values.dims:
            values = values.isel(start=0)
        figures.append((label, form, factor * values.transpose(over, across).to_numpy()))
    effects = one["disagreement"].transpose(over, across).to_numpy() if "disagreement" in one else None
    text = np.empty(classes.shape, dtype=object)
    for (j, i), code in np.ndenumerate(classes):
        lines = [f"<b>{names[int(code)] if code >= 0 else 'not done yet'}</b>"]
        lines.append(f"{layout.x.words} {x[i]:.2f} {layout.x.unit}, {layout.y.words} {y[j]:.2f} {layout.y.unit}")
        lines += [f"{label}: {values[j, i]:{form}}" for label, form, values in figures if np.isfinite(values[j, i])]
        if effects is not None and effects[j, i]:
            lines.append(f"statics disagree: {EFFECT_LABELS[Effect(int(effects[j, i]))]}")
        text[j, i] = "<br>".join(lines)
    return text
