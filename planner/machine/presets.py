"""Where machines start from: everything off, or the paper's prototype.

The paper gives no data sheet. The prototype is **calibrated, not measured**: its parameters are the
most probable ones within the ranges of parts of their kind, given that the largest error of θ₃ was
5 degrees (Fig. 9) and the motors followed their commands precisely (Fig. 10). `planner calibrate`
gives the numbers again and says which of them the paper cannot tell: results/calibration has the
ranges, their sources and the figures.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

IDEAL: Mapping[str, Any] = MappingProxyType({"step_s": 0.001})
"""No effects at all: the command is continuous and the kinematics are exact."""

PROTOTYPE: Mapping[str, Any] = MappingProxyType(
    {
        "step_s": 0.001,
        # Not fitted (planner.calibration.ranges.FIXED says why they are what they are).
        "control_period_s": 0.01,
        "delay_s": 0.005,
        "velocity_resolution_rad_s": 0.001,
        "input_gain_error": {"value": 0.0, "spread": 0.003},
        "input_bias_rad_s": {"value": 0.0, "spread": 0.0005},
        "velocity_limit_rad_s": 3.0,
        "acceleration_limit_rad_s2": 30.0,
        "servo_damping": False,
        "gear_ratio_error": {"value": 0.0, "spread": 0.005},
        "initial_play": {"value": 0.0, "spread": 0.5},
        "initial_angle_error_deg": {"value": 0.0, "spread": 0.2},
        "encoder_resolution_deg": 0.088,
        # What `planner calibrate` gives.
        "servo_bandwidth_rad_s": 67.3,
        "motor_inertia_kgm2": 0.02,
        "servo_gain_nms_per_rad": 5.03,
        "servo_integral_time_s": 0.0199,
        "torque_limit_nm": 2.45,
        "creep": 0.00317,
        "creep_per_nm": 0.00447,
        "friction_capacity_nm": {"value": 1.58, "spread": 0.158},
        "disk_inertia_kgm2": 0.000158,
        "gearhead_backlash_deg": {"value": 0.5, "spread": 0.1},
        "backlash_deg": {"value": 2.68, "spread": 0.536},
        "axis_inertia_kgm2": 1e-05,
        "shaft_stiffness_nm_per_rad": {"value": 3.26, "spread": 0.326},
        "shaft_damping_nms_per_rad": 0.02,
        "link_inertia_kgm2": 0.0316,
        "base_friction_nm": 0.157,
        "coulomb_friction_nm": {"value": 0.194, "spread": 0.0388},
        "viscous_friction_nms_per_rad": 0.0449,
    }
)

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {"prototype": PROTOTYPE, "ideal": IDEAL}
)
