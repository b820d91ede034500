"""Write an arm as URDF, the robot description of ROS: `urdf_text`.

The joints have the names of the arm's coordinates, so RViz can move them by a trajectory of
`joint_trajectory` with these names. See https://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from planner.errors import InputError
from planner.plan.plan import Plan
from planner.systems.triangular_system import PlanarArm

THICKNESS = 0.08
"""Width of a drawn link, relative to the mean link length."""

TORQUE_NM = 1.0
"""Torque of a joint, which no problem states, N m; with 0 a simulated joint could not move."""


def urdf_text(plan: Plan) -> str:
    """Return the arm of a plan as URDF: a base, and per joint a link that turns about the vertical.

    Lengths are those of `link_lengths`, in m. A joint's range is its limit in the problem or,
    without a limit, one turn each way. URDF also requires a maximum speed: the fastest that the
    limits of the inputs allow at any pose (at 0, where all cosines are 1), or without limits the
    plan's. And a maximum torque (`effort`), which is unknown: `TORQUE_NM`.

    Raises:
        InputError: If the plan's system is not a planar arm.
    """
    system = plan.problem.system
    if not isinstance(system, PlanarArm):
        raise InputError(f"a {system.kind} is not an arm; the format urdf is for arms")
    lengths = np.asarray(system.link_lengths, dtype=float)
    names = [coordinate.name for coordinate in system.coordinates[1:]]
    most = plan.problem.limits.joint[1:]
    times = np.linspace(0.0, plan.duration, 1001)
    speeds = np.abs(system.rates(plan.q(times), plan.u(times))[:, 1:]).max(axis=0)
    top = plan.problem.limits.input
    if np.all(np.isfinite(top)):
        speeds = np.maximum(speeds, np.abs(system.rates(np.zeros(system.size), top)[1:]))
    width = float(THICKNESS * lengths.mean())
    robot = ET.Element("robot", name="planner_arm")
    _add_link(robot, "base", 2 * width, width, 0.0)
    for i, (name, length) in enumerate(zip(names, lengths, strict=True)):
        _add_link(robot, f"link{i + 1}", float(length), width, float(length) / 2)
        joint = ET.SubElement(robot, "joint", name=name, type="revolute")
        ET.SubElement(joint, "parent", link=f"link{i}" if i else "base")
        ET.SubElement(joint, "child", link=f"link{i + 1}")
        ET.SubElement(joint, "origin", xyz=f"{lengths[i - 1] if i else 0.0!s} 0 0", rpy="0 0 0")
        ET.SubElement(joint, "axis", xyz="0 0 1")
        reach = float(most[i]) if np.isfinite(most[i]) else 2 * np.pi
        limits = {
            "lower": -reach,
            "upper": reach,
            "effort": TORQUE_NM,
            "velocity": float(speeds[i]),
        }
        ET.SubElement(joint, "limit", {key: repr(value) for key, value in limits.items()})
    _add_link(robot, "tip", width / 2, width / 2, 0.0)
    joint = ET.SubElement(robot, "joint", name="tip_joint", type="fixed")
    ET.SubElement(joint, "parent", link=f"link{len(lengths)}")
    ET.SubElement(joint, "child", link="tip")
    ET.SubElement(joint, "origin", xyz=f"{lengths[-1]!s} 0 0", rpy="0 0 0")
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ET.Element, name: str, length: float, width: float, middle: float) -> None:
    """Add a link, drawn as a box along x whose centre lies at x = `middle` from its joint, in m."""
    visual = ET.SubElement(ET.SubElement(robot, "link", name=name), "visual")
    ET.SubElement(visual, "origin", xyz=f"{middle!r} 0 0", rpy="0 0 0")
    box = ET.SubElement(visual, "geometry")
    ET.SubElement(box, "box", size=f"{length!r} {width!r} {width!r}")
