"""What makes a mass and an inertia tensor physically possible.

A rigid body of positive mass density has positive principal moments, and none of them exceeds the sum of the other two
(x^2 + y^2 integrates to no more than (y^2 + z^2) + (x^2 + z^2)). Pinocchio checks neither.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from m4_dynamics.robot.finding import Finding, Severity

__all__ = ["inertia_findings", "model_inertia_findings"]

#: Slack for figures that were rounded on their way into a file, relative to the largest principal moment ...
_RELATIVE_SLACK = 1e-6
#: ... and for zeros that were computed [kg m2].
_ABSOLUTE_SLACK = 1e-15


def inertia_findings(
    mass: float, inertia: NDArray[np.float64], where: str, *, negative_moment: Severity = "warning"
) -> list[Finding]:
    """Check one body's mass and inertia.

    Args:
        mass: Mass [kg].
        inertia: Inertia tensor about the centre of mass, shape (3, 3) [kg m2].
        where: The body, for the findings.
        negative_moment: How bad a negative principal moment is: harmless for a small link fixed to others, but not for
            a moving body.

    Returns:
        What is wrong with it; empty for a possible body.
    """
    if not (np.isfinite(mass) and np.isfinite(inertia).all()):
        return [Finding("error", where, "mass or inertia is not finite", "give finite numbers")]
    if mass < 0.0:
        return [Finding("error", where, f"negative mass {mass:g} kg", "give a mass of at least 0")]
    moments = np.linalg.eigvalsh(inertia)
    in_words = ", ".join(f"{moment:.4g}" for moment in moments)
    slack = _RELATIVE_SLACK * float(np.abs(moments).max()) + _ABSOLUTE_SLACK
    if moments[0] < -slack:
        return [
            Finding(
                negative_moment,
                where,
                f"inertia is not positive definite (principal moments {in_words} kg m2)",
                "a real body's principal moments are positive; check the products of inertia",
            )
        ]
    if moments[2] > moments[0] + moments[1] + slack:
        return [
            Finding(
                "warning",
                where,
                f"inertia breaks the triangle inequality (principal moments {in_words} kg m2)",
                "no body has a principal moment above the sum of the other two; take it from a simple shape",
            )
        ]
    if mass > 0.0 and moments[0] <= slack:
        return [
            Finding(
                "note",
                where,
                f"a mass of {mass:g} kg with a zero principal moment (principal moments {in_words} kg m2)",
                "right for a point mass or a thin rod only",
            )
        ]
    return []


def model_inertia_findings(model: pin.Model) -> list[Finding]:
    """Check that a model's motion is determined: no body has negative inertia, and every joint moves some.

    One impossible link among several that are fixed to each other may do no harm; a moving body with negative inertia
    does, and so does a joint that moves none: the accelerations are then meaningless, or infinite.

    Args:
        model: A model whose links have been merged into moving bodies.

    Returns:
        The bodies and joints for which that is not so, as errors.
    """
    findings = []
    for joint_id in range(1, model.njoints):
        body = model.inertias[joint_id]
        where = f"body of joint '{model.names[joint_id]}'"
        doubts = inertia_findings(body.mass, body.inertia, where, negative_moment="error")
        findings += [finding for finding in doubts if finding.severity == "error"]
    if findings:
        return findings
    diagonal = np.diag(pin.crba(model, model.createData(), pin.neutral(model)))
    for joint_id in range(1, model.njoints):
        joint = model.joints[joint_id]
        moved = diagonal[joint.idx_v : joint.idx_v + joint.nv]
        if (moved <= 0.0).any():
            where = f"joint '{model.names[joint_id]}'"
            what = "moves no inertia: what hangs on it has neither mass nor inertia about its axis"
            findings.append(Finding("error", where, what, "give the link an <inertial>, or make the joint fixed"))
    return findings
