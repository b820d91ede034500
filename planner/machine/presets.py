"""Where machines start from: everything off, or the paper's prototype.

The paper gives no data sheet. Each value of the prototype is plausible for a bench-top arm of the
paper's build (two geared servo motors, friction disks, small bevel gears, toothed belts, links of
some 0.2 m), within the range that its kind of part has in catalogues. **Calibrated, not measured**:
the play and the soft shafts, which the paper names first among the causes of its error, were then
set within their ranges so that the open-loop replay of a smooth polynomial plan from (1, 1, 1) to
(30, 30, 30) degrees in 10 s shows a median of about 5 degrees for the largest error of θ₃, as the
paper's Fig. 9 does, while the motors follow their commands closely, as its Fig. 10 shows. One
number cannot tell play, wind-up and creep apart: other mixtures give the same 5 degrees.
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
        # A PC of 2010 commanding two servo drives over a bus: 5 to 20 ms, one half period of delay.
        "control_period_s": 0.01,
        "delay_s": 0.005,
        # One motor rpm behind a 1:100 gearhead is 0.001 rad/s.
        "velocity_resolution_rad_s": 0.001,
        # Fig. 10: speed is followed precisely. Drives with encoders hold 0.1 to 0.5 % of it.
        "input_gain_error": {"value": 0.0, "spread": 0.003},
        # Drift of the zero of a velocity command: up to some 0.05 deg/s at the output.
        "input_bias_rad_s": {"value": 0.0, "spread": 0.0005},
        # 3000 to 4000 rpm behind 1:100, and a tenth of a second to reach it.
        "velocity_limit_rad_s": 3.0,
        "acceleration_limit_rad_s2": 30.0,
        # Velocity loops of small geared servos close at 5 to 30 Hz.
        "servo_bandwidth_rad_s": 60.0,
        "servo_damping": False,
        # Rotors of 10 to 40 g cm^2 (motors of 20 to 60 W) behind 1:100.
        "motor_inertia_kgm2": 0.02,
        # A velocity loop of 40 Hz around that inertia, reset in 10 to 50 ms.
        "servo_gain_nms_per_rad": 5.0,
        "servo_integral_time_s": 0.02,
        # Planetary gearheads of 32 mm: 2 to 6 N m.
        "torque_limit_nm": 3.0,
        # Creep of dry steel-on-polymer traction: 0.1 to 1 % at half of the torque that slips.
        "creep": 0.003,
        "creep_per_nm": 0.005,
        # mu N r = 0.25 * 200 N * 0.03 m.
        "friction_capacity_nm": {"value": 1.5, "spread": 0.15},
        # Two steel disks of 60 mm by 8 mm.
        "disk_inertia_kgm2": 0.00015,
        # Radii of disks and contacts to 0.1 mm on 20 mm.
        "gear_ratio_error": {"value": 0.0, "spread": 0.005},
        # Small planetary gearheads: 0.2 to 1 deg.
        "gearhead_backlash_deg": {"value": 0.5, "spread": 0.1},
        # Straight bevel gears and belts of small radius: 0.1 to 0.5 mm on 5 to 10 mm is 1 to 5 deg.
        "backlash_deg": {"value": 4.0, "spread": 0.8},
        "initial_play": {"value": 0.0, "spread": 0.5},
        # Bevel gear, shaft and pulley: 50 g on 10 to 20 mm.
        "axis_inertia_kgm2": 0.00001,
        # A steel shaft of 3 mm and 0.2 m has 3 N m/rad, one of 4 mm has 10; belts are softer still.
        "shaft_stiffness_nm_per_rad": {"value": 4.0, "spread": 0.4},
        # 2 to 5 % of critical damping, mostly in the belt.
        "shaft_damping_nms_per_rad": 0.02,
        # Links of 0.2 m and 0.3 to 1 kg with the next joint at their end.
        "link_inertia_kgm2": 0.03,
        "base_friction_nm": 0.2,
        # Bearings, belt tension and the friction disks of the next joint, which this one carries.
        "coulomb_friction_nm": {"value": 0.2, "spread": 0.04},
        "viscous_friction_nms_per_rad": 0.05,
        # Set by eye or against a stop, before each run.
        "initial_angle_error_deg": {"value": 0.0, "spread": 0.2},
        # 1024 lines, four edges a line, on the joint itself.
        "encoder_resolution_deg": 0.088,
    }
)

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {"prototype": PROTOTYPE, "ideal": IDEAL}
)
