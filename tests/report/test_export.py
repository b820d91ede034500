"""Plans as files of other programs: what they hold, what is refused, and the way back."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compared import outside
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.io import loadmat

import planner
from planner import load_samples
from planner.plan.plan_file import plan_schema
from planner.plan.samples import held_miss, sample
from planner.problem.tables.kinds import json_schema
from planner.report.export import FORMATS, Format, find_format
from planner.report.figures.style import curves

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def law(unlimited: planner.Problem) -> planner.Plan:
    return planner.solve(unlimited.changed({"goal.travel": 0.825}), "polynomial")


@pytest.fixture(scope="module")
def rest(paper: planner.Problem) -> planner.Plan:
    return planner.solve(paper, "collocation", rest=True)


@pytest.fixture(scope="module")
def retimed() -> planner.Plan:
    plan = planner.solve(planner.load_problem(ROOT / "problems/unicycle.toml"), "polynomial")
    limits = {"acceleration_m_s2": 2.0, "turn_acceleration_rad_s2": 2.0}
    return planner.retime(plan, limits, rest=True, intervals=10)


def export_moving(plan: planner.Plan, path: Path, **options: Any) -> Path:
    """Export a plan that does not start at rest, which is said."""
    with pytest.warns(planner.InputWarning, match=r"\|.*\| = .*rest = true"):
        return planner.export(plan, path, **options)


def test_a_compensated_plan_with_limited_rates_starts_at_rest(
    paper: planner.Problem, tmp_path: Path
) -> None:
    """So the first row of a table, too, keeps the limit from standstill."""
    slow = paper.changed({"limits.input_rate_rad_s2": 2.0})
    plan = planner.compensate(planner.solve(slow, intervals=20))
    assert plan.u(0.0).tolist() == [0.0, 0.0]
    assert 0 < np.abs(plan.u(0.01)).max() <= 2.0 * 0.01 * (1 + 1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        samples = planner.load_samples(planner.export(plan, tmp_path / "x.csv"))
    np.testing.assert_array_equal(samples.u[-1], 0.0)
    with pytest.raises(planner.InputError, match=r"compensated: .* csv"):
        planner.export(plan, tmp_path / "x.yaml")
    free = planner.compensate(planner.solve(paper, intervals=20))
    with pytest.warns(planner.InputWarning, match="limits.input_rate_rad_s2=2"):
        planner.export(free, tmp_path / "x.csv")


def test_samples_are_even_and_end_on_the_end(law: planner.Plan) -> None:
    samples = sample(law, 7.3)
    assert len(samples.t) == 74
    assert samples.t[-1] == law.duration
    np.testing.assert_allclose(np.diff(samples.t), 10 / 73, rtol=1e-12)
    np.testing.assert_array_equal(samples.q, law.q(samples.t))
    assert samples.columns[:3] == ("t_s", "phi2_rad", "theta1_rad")
    assert samples.columns[-3:] == ("z4", "v1", "v2")


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1e9, True])
def test_rates_that_make_no_sense(law: planner.Plan, rate: float) -> None:
    with pytest.raises(planner.InputError, match="rate_hz"):
        sample(law, rate)


@pytest.mark.parametrize("name", ["x.csv", "x.mat"])
@pytest.mark.parametrize("study", [False, True], ids=["plan", "for study"])
def test_samples_come_back_exactly(
    law: planner.Plan, tmp_path: Path, name: str, study: bool
) -> None:
    plan = outside() if study else law
    back = load_samples(export_moving(plan, tmp_path / name, rate_hz=20))
    there = sample(plan, 20)
    assert back.columns == there.columns
    np.testing.assert_array_equal(back.table, there.table)
    assert np.isnan(back.q).any() == study


def test_commands_end_with_zeros_and_turn_the_motors_that_far(
    law: planner.Plan, rest: planner.Plan, tmp_path: Path
) -> None:
    back = load_samples(export_moving(law, tmp_path / "x.csv", rate_hz=50))
    assert abs(law.u(law.duration)[0]) > 0.01  # it ends in motion
    assert np.all(back.table[-1, 5:7] == 0)
    assert np.all(back.v[-1] == 0)
    means = np.diff(back.motors, axis=0) / np.diff(back.t)[:, None]
    np.testing.assert_allclose(back.u[:-1], means, atol=1e-12)
    for k in (0, 100, 500):
        turned = quad(lambda s: law.u(s)[0], 0, back.t[k], epsabs=1e-12)[0]
        assert back.motors[k, 0] == pytest.approx(turned, abs=1e-9)
    np.testing.assert_allclose(back.motors[:, 1], back.q[:, 1], atol=1e-7)  # motor 2 turns θ₁
    planner.export(rest, tmp_path / "y.csv")  # and no warning


def hold_rows(samples: planner.Samples, system: Any) -> np.ndarray:
    """Where rows that are held lead, by SciPy's integrator, in degrees."""
    q = samples.q[0]
    for begin, end, u in zip(samples.t, samples.t[1:], samples.u, strict=False):
        found = solve_ivp(
            lambda t, x, u=u: system.rates(x, u), (begin, end), q, rtol=1e-9, atol=1e-11
        )
        q = found.y[:, -1]
    return np.rad2deg(q)


@pytest.mark.parametrize(("rate", "most"), [(100, 1e-3), (10, 0.02), (1, 2.0)])
def test_rows_that_are_held_reach_the_goal(
    law: planner.Plan, tmp_path: Path, rate: float, most: float
) -> None:
    """A plan that is not at rest; with the value at each row's begin joint 1 ended off by 0.07,
    0.7 and 7 degrees. What is left is told."""
    samples = load_samples(export_moving(law, tmp_path / "x.csv", rate_hz=rate))
    miss = hold_rows(samples, law.problem.system) - np.rad2deg(law.q(law.duration))
    assert np.max(np.abs(miss)) < most
    assert abs(miss[1]) < 1e-6  # joint 1 turns as motor 2
    np.testing.assert_allclose(np.rad2deg(held_miss(law, rate)), miss, atol=1e-5)


def test_a_compensated_plan_holds_its_commands_already(rest: planner.Plan) -> None:
    commanded = planner.compensate(rest)
    held = sample(commanded, 100)
    middle = (held.t[:-1] + held.t[1:]) / 2
    np.testing.assert_allclose(held.u[:-1], commanded.u(middle), atol=1e-9)
    assert np.max(np.abs(held_miss(commanded, 100))) < 1e-9


def test_motor_angles_of_a_compensated_plan_are_those_commanded(
    rest: planner.Plan, tmp_path: Path
) -> None:
    commanded = planner.compensate(rest)
    back = sample(commanded, 100)
    end = (
        back.q[0, 1]
        + quad(
            lambda s: commanded.u(s)[1],
            0,
            back.t[-1],
            points=commanded.t,
            limit=5 * len(commanded.t),
        )[0]
    )
    assert back.motors[-1, 1] == pytest.approx(end, abs=1e-7)
    assert abs(end - back.q[-1, 1]) > np.deg2rad(0.01)  # some of it is lost in the gearhead
    assert [curve.label for curve in curves(commanded)] == ["collocation compensated"]


def test_csv_is_a_plain_table(law: planner.Plan, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(export_moving(law, tmp_path / "x.csv", rate_hz=5), index_col="t_s")
    pandas.testing.assert_frame_equal(frame, law.to_frame(5), check_exact=True)


def test_matlab_sees_names_and_facts(law: planner.Plan, tmp_path: Path) -> None:
    data = loadmat(export_moving(law, tmp_path / "x.mat", rate_hz=5), simplify_cells=True)
    assert list(data["coordinates"]) == ["phi2_rad", "theta1_rad", "theta2_rad", "theta3_rad"]
    assert (data["about"]["method"], data["about"]["verified"]) == ("polynomial", 1)
    assert data["about"]["starts_at_rest"] == 0
    assert list(data["axes"]) == ["motor1_rad", "motor2_rad"]
    assert json.loads(data["about"]["problem_json"]) == law.problem.to_dict()
    assert loadmat(tmp_path / "x.mat")["t"].shape == (51, 1)


def test_json_is_the_plan_itself(law: planner.Plan, tmp_path: Path) -> None:
    back = planner.load_plan(planner.export(law, tmp_path / "x.json"))
    np.testing.assert_array_equal(back.u(3.21), law.u(3.21))


def cut(value: Any) -> Any:
    """The same form with short lists: the schema says nothing about how long they are."""
    if isinstance(value, dict):
        return {key: cut(item) for key, item in value.items()}
    return [cut(item) for item in value[:5]] if isinstance(value, list) else value


def test_schema_of_plans_accepts_every_kind_and_no_slip(
    law: planner.Plan, rest: planner.Plan, retimed: planner.Plan, tmp_path: Path
) -> None:
    import jsonschema  # slow

    schema = plan_schema(json_schema())
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    for plan in (law, rest, retimed):
        text = plan.save(tmp_path / "x.json").read_text()
        assert "NaN" not in text
        data = json.loads(text) | {"trajectory": cut(json.loads(text)["trajectory"])}
        validator.validate(data)
        if plan.trajectory.kind != "chained":
            continue
        assert not validator.is_valid({**data, "version": 2})
        assert not validator.is_valid({**data, "vrsion": 1})
        assert not validator.is_valid({**data, "problem": {**data["problem"], "gaol": {}}})
        trajectory = {**data["trajectory"], "kind": "spline"}
        assert not validator.is_valid({**data, "trajectory": trajectory})


def test_a_number_that_is_not_defined_survives_as_null(tmp_path: Path) -> None:
    path = replace(outside(), objective=float("nan")).save(tmp_path / "x.json")
    assert '"objective": null' in path.read_text()
    assert np.isnan(planner.load_plan(path).objective)


def follows_the_rules(message: dict) -> None:
    """Rules of the message definition, and of the controller of ros2_control."""
    names, points = message["joint_names"], message["points"]
    assert len(set(names)) == len(names)
    stamps = [p["time_from_start"] for p in points]
    for stamp in stamps:
        assert type(stamp["sec"]) is int
        assert -(2**31) <= stamp["sec"] < 2**31
        assert type(stamp["nanosec"]) is int
        assert 0 <= stamp["nanosec"] < 1_000_000_000
    whole = [s["sec"] * 1_000_000_000 + s["nanosec"] for s in stamps]
    assert all(a < b for a, b in pairwise(whole))
    for point in points:
        for key in ("positions", "velocities", "accelerations"):
            assert len(point[key]) == len(names)
            assert all(type(x) is float and np.isfinite(x) for x in point[key])
        assert point["effort"] == []
    assert points[-1]["velocities"] == points[0]["velocities"] == [0.0, 0.0]


def test_ros_trajectory_reads_as_yaml_and_follows_the_rules(
    rest: planner.Plan, tmp_path: Path
) -> None:
    yaml = pytest.importorskip("yaml")
    path = planner.export(rest, tmp_path / "x.yaml", rate_hz=33, joint_names=["disk", "joint1"])
    message = yaml.safe_load(path.read_text())
    follows_the_rules(message)
    assert message["joint_names"] == ["disk", "joint1"]
    end = message["points"][-1]["time_from_start"]
    assert end["sec"] + 1e-9 * end["nanosec"] == pytest.approx(rest.duration, abs=1e-9)


def test_another_timing_brings_a_law_to_rest(retimed: planner.Plan, sent: Callable) -> None:
    message = sent(retimed, 50)
    follows_the_rules(message)
    assert message["joint_names"] == ["speed", "turn_rate"]
    assert message["points"][-1]["positions"][0] > np.hypot(2.0, 1.0)


def test_ros_positions_velocities_and_accelerations_belong_together(
    rest: planner.Plan, sent: Callable
) -> None:
    points = sent(rest, 100)["points"]
    t = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"]
                  for p in points])  # fmt: skip
    position, velocity, acceleration = (
        np.array([p[key] for p in points]) for key in ("positions", "velocities", "accelerations")
    )
    for i in range(2):
        between = CubicHermiteSpline(t, position[:, i], velocity[:, i])
        middle = (t[1:] + t[:-1]) / 2
        mean = np.diff(velocity[:, i]) / np.diff(t)
        inside = [k for k in range(len(mean)) if not np.any((rest.t > t[k]) & (rest.t < t[k + 1]))]
        assert len(inside) > 500  # the others hold a corner of the input
        wanted = rest.u(middle)[inside, i]
        np.testing.assert_allclose(between(middle, 1)[inside], wanted, atol=2e-5)
        np.testing.assert_allclose(acceleration[:-1][inside, i], mean[inside], atol=1e-6)
    total = sum(
        quad(lambda s: rest.u(s)[0], a, b)[0] for a, b in zip(rest.t, rest.t[1:], strict=False)
    )
    assert position[-1, 0] == pytest.approx(total, abs=1e-9)
    np.testing.assert_allclose(np.rad2deg(position[[0, -1], 1]), [1, 30], atol=1e-5)


def test_a_slow_trajectory_passes_the_same_points(rest: planner.Plan) -> None:
    from planner.report.export import joint_trajectory

    slow, usual = (
        joint_trajectory(rest, 10, slow=10)["points"],
        joint_trajectory(rest, 100)["points"],
    )
    assert len(slow) == len(usual)
    assert slow[-1]["time_from_start"]["sec"] == 10 * usual[-1]["time_from_start"]["sec"]
    for key, share in (("positions", 1.0), ("velocities", 0.1), ("accelerations", 0.01)):
        wanted = share * np.array([point[key] for point in usual])
        np.testing.assert_allclose([point[key] for point in slow], wanted, atol=1e-6 * share)


def test_small_numbers_are_numbers_in_yaml(rest: planner.Plan, tmp_path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    from planner.report.export import yaml_text

    data = {"header": {}, "joint_names": [], "points": [{"x": [1e-05, 1e22, -3e-300, 0.5]}]}
    assert yaml.safe_load(yaml_text(data))["points"] == data["points"]


def test_ros_needs_rest(law: planner.Plan, tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match=r"rest = true.*retime"):
        planner.export(law, tmp_path / "x.yaml")
    assert list(tmp_path.iterdir()) == []


def test_ros_refuses_what_ends_moving_or_jumps(rest: planner.Plan, sent: Callable) -> None:
    steps = rest.trajectory.u_curve  # type: ignore[attr-defined]
    from scipy.interpolate import BPoly

    def with_inputs(c: np.ndarray) -> planner.Plan:
        curve = BPoly(c, steps.x)
        loose = rest.problem.changed({"limits": {}})
        return replace(rest, problem=loose, trajectory=replace(rest.trajectory, u_curve=curve))

    moving = steps.c.copy()
    moving[-1, -1, 0] += 1e-5
    with pytest.raises(planner.InputError, match=r"\|u1\| = 1e-05 rad/s"):
        sent(with_inputs(moving))
    jump = steps.c.copy()
    jump[-1, 10, 1] += 1e-6
    with pytest.raises(planner.InputError, match=r"u2 .* 1e-06 rad/s .*t = "):
        sent(with_inputs(jump))


def test_ros_refuses_what_fails_its_verification(rest: planner.Plan, sent: Callable) -> None:
    elsewhere = rest.problem.changed({"goal.theta_deg": [31, 30, 30]})
    with pytest.raises(planner.InputError, match="goal theta1"):
        sent(replace(rest, problem=elsewhere))
    with pytest.raises(planner.InputError, match="cannot be sent to a robot"):
        sent(outside())


@pytest.mark.parametrize("names", [["a"], ["a", "a"], ["a", ""], ["a", "b", "c"]])
def test_joint_names_are_two(rest: planner.Plan, names: list[str], sent: Callable) -> None:
    with pytest.raises(planner.InputError, match="two different names"):
        sent(rest, 10, names)


def test_dataset_has_names_and_units(law: planner.Plan, tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    data = law.to_xarray(10)
    np.testing.assert_array_equal(data.q.sel(coordinate="theta2"), law.q(data.time.values)[:, 2])
    assert data.unit_of_u.sel(input="u1") == "rad/s"
    assert data.time.attrs["units"] == "s"
    assert data.attrs["method"] == "polynomial"
    np.testing.assert_array_equal(data.z.sel(chained="z3"), law.z(data.time.values)[:, 2])


def test_a_format_is_one_entry(
    law: planner.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = Format(
        "times alone",
        (".ends",),
        lambda plan, asked: f"{plan.t[-1]} {asked.rate_hz}",
        is_command=False,
    )
    monkeypatch.setitem(FORMATS, "ends", ends)
    written = planner.export(law, tmp_path / "x.ends", rate_hz=7.0)
    assert written.read_text() == f"{law.duration} 7.0"
    for option, words in (
        ({"joint_names": ["a", "b"]}, "joint names; formats that have one: ros2"),
        ({"real": "float"}, "type of numbers; formats that have one: c"),
        ({"machine": planner.Machine.ideal()}, "machine; formats that have one: c"),
    ):
        with pytest.raises(planner.InputError, match=f"'ends' .* {words}"):
            planner.export(law, tmp_path / "x.ends", **option)
    with pytest.raises(planner.InputError, match=r"\.ends\); name .*, ends$"):
        planner.export(law, tmp_path / "x.dat")
    with pytest.raises(planner.InputError, match="'ends'"):
        planner.export(law, tmp_path / "x.dat", "end")


@pytest.mark.parametrize("word", ["matlab", "mat"])
def test_a_format_is_named_by_its_name_or_its_ending(word: str) -> None:
    assert find_format("a.bin", word) == find_format("a.mat", None) == "matlab"


def test_no_ending_means_two_formats() -> None:
    endings = [ending for one in FORMATS.values() for ending in one.endings]
    assert sorted(endings) == sorted(set(endings))


@pytest.mark.parametrize(
    ("name", "format", "says"),
    [
        ("x.dat", None, r"x\.dat is not that of a format"),
        ("x.csv", "cvs", "did you mean 'csv'"),
        ("", "csv", "it is a folder"),
    ],
)
def test_bad_names_are_refused(
    law: planner.Plan, tmp_path: Path, name: str, format: str | None, says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.export(law, tmp_path / name, format)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("x.txt", "", "must end in"),
        ("x.csv", "", "x.csv is empty"),
        ("x.csv", "a,b\n1,2\n", "does not hold the samples"),
        ("x.csv", "t_s,a_1,b_1,u_1,w_1,m_1,n_1,z1,z2,v1,v2\n1,2\n", "line 2: 2 cells"),
        ("x.csv", "t_s,a_1,b_1,u_1,w_1,m_1,n_1,z1,z9,v1,v2\n1,2,3,4,5,6,7,8,9,10,11\n", "z9"),
        ("x.mat", "hello", "does not hold the samples"),
    ],
)
def test_files_that_hold_no_samples(tmp_path: Path, name: str, text: str, says: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(planner.InputError, match=says):
        load_samples(tmp_path / name)
    with pytest.raises(planner.InputError, match="cannot read"):
        load_samples(tmp_path / "missing.csv")


def test_samples_that_a_spreadsheet_saved_are_read(law: planner.Plan, tmp_path: Path) -> None:
    """Semicolons, decimal commas and a byte order mark; a cell that is no number is named."""
    path = export_moving(law, tmp_path / "x.csv", rate_hz=5)
    samples, text = load_samples(path), path.read_text("utf-8")
    path.write_text(text.replace(",", ";").replace(".", ","), "utf-8-sig")
    np.testing.assert_array_equal(load_samples(path).table, samples.table)
    path.write_text(text.replace("\n0.2,", "\n1_0,"), "utf-8")
    with pytest.raises(
        planner.InputError, match=r"x\.csv, line 3: column 't_s' is '1_0', which is"
    ):
        load_samples(path)


def test_other_systems_name_their_columns(tmp_path: Path) -> None:
    plan = planner.solve(planner.load_problem(ROOT / "problems/unicycle.toml"), "polynomial")
    back = load_samples(export_moving(plan, tmp_path / "x.csv", rate_hz=5))
    assert back.axes == ("motor1_m", "motor2_rad")
    first = plan.problem.system.inputs[0]
    assert back.inputs[0] == f"{first.name}_m_s"
    assert back.coordinates[0] == "x_m"


@pytest.mark.parametrize("rate_hz", [100.0, 7.0, 0.05])
def test_rows_are_a_step_apart_whatever_the_duration(
    paper: planner.Problem, tmp_path: Path, rate_hz: float
) -> None:
    """The duration is no multiple of the step: the motors take the whole last one for the rest."""
    plan = planner.solve(paper.changed({"goal.duration": 9.9876}), rest=True)
    samples = planner.load_samples(planner.export(plan, tmp_path / "plan.csv", rate_hz=rate_hz))
    np.testing.assert_allclose(np.diff(samples.t), 1 / rate_hz, rtol=1e-12)
    assert 0 <= samples.t[-1] - plan.duration < 1 / rate_hz
    np.testing.assert_allclose(samples.q[-1], plan.user(plan.duration), atol=1e-12)
    turned = np.sum(samples.u[:-1] / rate_hz, axis=0)
    np.testing.assert_allclose(turned, samples.motors[-1] - samples.motors[0], atol=1e-12)
