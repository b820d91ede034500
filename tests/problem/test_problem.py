import numpy as np
import pytest

import planner


def test_paper_file_says_what_the_paper_says(paper: planner.Problem) -> None:
    np.testing.assert_allclose(np.rad2deg(paper.start[1:]), [1, 1, 1])
    np.testing.assert_allclose(np.rad2deg(paper.goal[1:]), [30, 30, 30])
    assert np.isnan(paper.goal[0])
    assert paper.travel is None
    assert paper.duration == 10.0
    np.testing.assert_array_equal(paper.limits.input, [0.5, 0.5])
    assert np.all(np.isinf(paper.limits.input_rate))
    assert paper.z2_sign == -1


def test_changes_are_checked_and_leave_the_original_alone(paper: planner.Problem) -> None:
    changed = paper.changed({"goal.travel": 0.8, "limits.joint_deg": [70, 60, 50]})
    assert changed.travel == 0.8
    np.testing.assert_allclose(np.rad2deg(changed.limits.joint[1:]), [70, 60, 50])
    assert paper.travel is None
    with pytest.raises(planner.InputError, match=r"'goal\.travle'.*'travel'"):
        paper.changed({"goal.travle": 0.8})


def test_limits_left_out_are_infinite(unlimited: planner.Problem) -> None:
    assert np.all(np.isinf(unlimited.limits.input))
    assert np.all(np.isinf(unlimited.limits.joint))
    assert unlimited.limits.z2_margin is None


def test_gear_geometry_supplies_the_constants(paper: planner.Problem) -> None:
    gear = {"r1": 0.8178, "R": 1.0, "r3": 1.2, "lambda": 1.0, "eta": 1.0}
    data = paper.to_dict()
    data["system"] = {"kind": "manipulator", "joints": 4, "gear": gear}
    data["start"] = data["goal"] = {"theta_deg": [1, 2, 3, 4]}
    data["limits"] = {}
    system = planner.Problem.from_dict(data).system
    assert isinstance(system, planner.Manipulator)
    rho = 0.8178
    assert system.k_g == pytest.approx(rho**2)
    assert system.k_g_rule.startswith("chain")
    k = [1 / 1.2 * rho ** (i - 1) for i in (2, 3, 4)]
    np.testing.assert_allclose(system.K, np.array(k) / rho**2)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_rule_of_the_gear_is_the_chains_and_the_printed_one_can_be_asked_for(n: int) -> None:
    gear = {"r1": 0.7, "R": 1.1, "r3": 1.2, "lambda": 0.9, "eta": 1.3}
    system = {"kind": "manipulator", "joints": n, "gear": gear}
    angles = {"theta_deg": [5.0] * n}

    def built(**more: object) -> planner.Manipulator:
        data = {"system": system | more, "start": angles, "goal": angles | {"duration": 1.0}}
        made = planner.Problem.from_dict(data).system
        assert isinstance(made, planner.Manipulator)
        return made

    rho = 0.7 / (0.9 * 1.1)
    chain, printed, given = built(), built(k_g_rule="printed"), built(k_g=0.4)
    assert chain.k_g == pytest.approx(rho ** (n - 2))
    assert printed.k_g == pytest.approx(rho**2)
    assert given.k_g == 0.4
    assert given.k_g_rule == "given"
    for arm in (chain, printed, given):  # the joints' own constants do not depend on the rule
        np.testing.assert_allclose(arm.k_g * arm.K, chain.k_g * chain.K, rtol=1e-14)


def test_the_chains_rule_is_what_the_stages_do_one_by_one() -> None:
    """Stage i turns B_i+1 by r1 cos(theta_i)/(lambda R) of B_i; B_n-1 is n - 2 stages from B_1."""
    gear, n = planner.Gear(0.7, 1.1, 1.2, 0.9, 1.3), 5
    q = np.array([0.0, 0.3, 0.5, -0.4, 0.2, 0.7])
    speed = 1.0
    for theta in q[1 : n - 1]:
        speed *= gear.r1 * np.cos(theta) / (gear.lam * gear.R)
    arm = planner.Manipulator.from_gear(n, gear)
    assert arm.rates(q, np.array([1.0, 0.0]))[0] == pytest.approx(speed, rel=1e-14)
    two = planner.Manipulator.from_gear(2, gear)
    assert two.rates(q[:3], np.array([1.0, 0.0]))[0] == 1.0  # phi1' = u1, eq. (6)


def test_stages_that_differ_are_lists_of_the_gear() -> None:
    """A stage hands its disk's speed to the next wheel B, and through the belt to its joint."""
    r1, R, r3 = [30.0, 25.0, 20.0], [36.0, 30.0, 28.0], [35.0, 30.0, 25.0]
    lam, eta = 0.9, [2.0, 0.5, 1.2]
    gear = {"r1": r1, "R": R, "r3": r3, "lambda": lam, "eta": eta}
    arm = planner.Problem.manipulator([1] * 4, [20] * 4, gear=gear).system
    assert isinstance(arm, planner.Manipulator)
    wheel, rates = 1.0, []
    for j in range(3):
        rim = r1[j] * wheel
        rates.append(rim / r3[j] / eta[j])
        disk, wheel = wheel, rim / R[j] / lam
    np.testing.assert_allclose(arm.k_g * arm.K, rates, rtol=1e-14)
    assert arm.k_g == pytest.approx(disk, rel=1e-14)
    assert arm.gear is None
    with pytest.raises(planner.InputError, match=r"gear\.r1 \D*2 \D*joints = 4 \D*3\b"):
        planner.Problem.manipulator([1] * 4, [20] * 4, gear=gear | {"r1": [30.0, 25.0]})
    with pytest.raises(planner.InputError, match=r"4 \D*3 \D*2$"):
        planner.Manipulator.from_gear(4, 2 * [planner.Gear(30.0, 36.0, 35.0, lam, 2.0)])
    changes = {"system.k_g_rule": "printed"}
    with pytest.raises(planner.InputError, match="needs equal stages"):
        planner.Problem.manipulator([1] * 4, [20] * 4, gear=gear, changes=changes)
