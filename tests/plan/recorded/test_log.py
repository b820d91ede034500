"""Recorded runs: what is read, what is refused and in which words, and a log as a plan."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from planner import (
    InputError,
    InputWarning,
    Log,
    Machine,
    Problem,
    emulate_log,
    excitation,
    read_log,
    replay,
    solve,
)

T = 0.01 * np.arange(101)
U = np.stack([np.where(T < 0.9, 0.3, 0.0), 0.4 * np.sin(2 * np.pi * T)], axis=1)
THETA = np.stack([0.064 * (1 - np.cos(2 * np.pi * T)), 0.1 * T, -0.05 * T], axis=1)
LOG = Log(T, U, THETA)
DEG, RPM = 180 / np.pi, 30 / np.pi


def write(path: Path, header: str, *columns: np.ndarray) -> Path:
    rows = np.column_stack(columns)
    lines = [",".join(f"{x:.12g}" for x in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def test_a_log_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    back = read_log(LOG.save(tmp_path / "a.csv"))
    np.testing.assert_allclose(back.t, T, atol=1e-12)
    np.testing.assert_allclose(back.u, U, atol=1e-8)
    np.testing.assert_allclose(back.theta, THETA, atol=1e-9)
    assert back.is_even
    assert back.interval_s == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ("t_ms,u1 (rpm),u2 [deg/s],theta1_deg,theta2_rad,theta3 (deg)", (1e3, RPM, DEG)),
        ("T_ns,U1_rad_s,U2_deg_s,THETA1_DEG,theta2_RAD,theta3_deg", (1e9, 1.0, DEG)),
    ],
)
def test_units_are_those_of_the_header(tmp_path: Path, header: str, scale: tuple) -> None:
    time, u1, u2 = scale
    columns = (5.0 + T * time, U[:, 0] * u1, U[:, 1] * u2)
    angles = (THETA[:, 0] * DEG, THETA[:, 1], THETA[:, 2] * DEG)
    log = read_log(write(tmp_path / "a.csv", header, *columns, *angles))
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    np.testing.assert_allclose(log.u, U, atol=1e-9)
    np.testing.assert_allclose(log.theta, THETA, atol=1e-9)


def test_columns_of_another_program_are_named_by_a_map(tmp_path: Path) -> None:
    """Epochs in nanoseconds, further columns, and names that mean nothing to us."""
    stamps = 1.7e18 + 1e9 * T
    header = "stamp,temperature,cmd[0],cmd[1],pos[0],pos[1],pos[2]"
    path = write(tmp_path / "bag.csv", header, stamps, 7 * T, *U.T, *THETA.T)
    ours = ["t_ns", "u1_rad_s", "u2_rad_s", "theta1_rad", "theta2_rad", "theta3_rad"]
    theirs = ["stamp", "cmd[0]", "cmd[1]", "pos[0]", "pos[1]", "pos[2]"]
    log = read_log(path, dict(zip(ours, theirs, strict=True)))
    np.testing.assert_allclose(log.t, T, atol=1e-6)
    np.testing.assert_allclose(log.theta, THETA, atol=1e-9)
    with pytest.raises(InputError, match=r"'pos\[3\]' .*theta1_rad"):
        read_log(path, {"theta1_rad": "pos[3]"})
    with pytest.raises(InputError, match="'angle'"):
        read_log(path, {**dict(zip(ours, theirs, strict=True)), "angle": "temperature"})


@pytest.mark.parametrize(
    "header",
    [
        "time_s,u1_rad_s,u2_rad_s,θ1 [°],θ2 [˚],θ3 [∘]",
        "Time (s),U_1 (rad/s),U_2 (rad/s),θ₁ (deg),θ₂ (deg),θ₃ (deg)",
        "t / s,u1 / (rad/s),u2 / (rad s⁻¹),ϑ1 / °,ϑ2 / °,ϑ3 / º",
        "timestamp [sec],u1 [rad·s^-1],u2 rad/sec,theta1 in degrees,theta2: deg,theta 3 [°]",
        "t,u1,u2,theta1,theta2,theta3\ns,rad/s,[rad/s],°,(deg),degrees",
        "s,rad/s,[rad/s],°,(deg),degrees\nt,u1,u2,theta1,theta2,theta3",
        't_s,"u1\n[rad/s]","u2\n[rad/s]",theta1_deg,theta2_deg,theta3_deg',
        "T_motor,t_s,u1_rad_s,u1_measured_rad_s,u2_rad_s,theta1_deg,theta1_ref_deg,theta2_deg,"
        "theta3_deg,torque",
    ],
)
def test_names_and_units_are_spelled_in_many_ways(tmp_path: Path, header: str) -> None:
    columns = [T, *U.T, *np.rad2deg(THETA).T]
    if "torque" in header:
        columns = [7 * T, T, U[:, 0], 9 * T, U[:, 1], np.rad2deg(THETA[:, 0]), 9 * T]
        columns += [*np.rad2deg(THETA[:, 1:]).T, T]
    log = read_log(write(tmp_path / "a.csv", header, *columns))
    np.testing.assert_allclose(np.c_[log.t, log.u, log.theta], np.c_[T, U, THETA], atol=1e-9)
    semicolons = tmp_path / "b.csv"
    text = (tmp_path / "a.csv").read_text("utf-8").replace(",", ";").replace(".", ",")
    semicolons.write_text(text, encoding="utf-16")
    np.testing.assert_array_equal(read_log(semicolons).theta, log.theta)


def test_a_unit_below_the_header_may_not_be_another(tmp_path: Path) -> None:
    header = "t_s,u1_rad_s,u2_rad_s,theta1_deg,theta2,theta3\ns,rad/s,rad/s,rad,rad,rad"
    with pytest.raises(InputError, match=r"'theta1_deg' .*'deg'.*'rad'"):
        read_log(write(tmp_path / "a.csv", header, T, *U.T, *THETA.T))


def test_a_blank_command_holds_the_one_above_and_a_blank_angle_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", HEADER, T, *U.T, *THETA.T)
    rows = [row.split(",") for row in path.read_text("utf-8").splitlines()]
    blank = []
    for above, row in pairwise(rows):
        if row[1] == above[1]:
            blank.append(row)
    assert len(blank) > 90
    for row in blank:
        row[1] = ""
    path.write_text("\n".join(map(",".join, rows)) + "\n", "utf-8")
    np.testing.assert_allclose(read_log(path).u, U, atol=1e-9)
    rows[1][2] = ""
    path.write_text("\n".join(map(",".join, rows)) + "\n", "utf-8")
    with pytest.raises(InputError, match=r"line 2: .*'u2_rad_s'"):
        read_log(path)


def test_the_last_row_of_a_log_that_was_cut_is_left_out(tmp_path: Path) -> None:
    """A number cut inside is another number: 5.73 degrees was read as 5."""
    whole = write(tmp_path / "a.csv", HEADER, T, *U.T, *THETA.T).read_text("utf-8")
    for cut in (1, 2, 5, 9):
        (tmp_path / "b.csv").write_text(whole[:-cut], "utf-8")
        with pytest.warns(InputWarning, match="line 102 "):
            log = read_log(tmp_path / "b.csv")
        np.testing.assert_allclose(log.theta, THETA[:-1], atol=1e-9)


HEADER = "t_s,u1_rad_s,u2_rad_s,theta1_rad,theta2_rad,theta3_rad"


def changed(column: int, row: int, value: float) -> list[np.ndarray]:
    columns = [T.copy(), *U.T.copy(), *THETA.T.copy()]
    columns[column][row] = value
    return columns


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        (HEADER, [T[:40], *U[:40].T, *THETA[:40].T], r"has 40 rows of readings; a log has 50 to"),
        (HEADER, changed(0, 50, 0.2), r"line 52: time goes from 0\.49 to 0\.2 s; it must increase"),
        (HEADER, [T + (T > 0.5), *U.T, *THETA.T], r"line 53: a gap of 1\.01 s after t = 0\.5 s"),
        (
            HEADER,
            changed(4, 7, np.nan),
            r"line 9: column 'theta2_rad' is 'nan', which is not a number",
        ),
        (HEADER, changed(5, 30, 0.9), r"line 32: theta3 jumps from .* deg at t = 0\.3 s: .* wrong"),
        (
            HEADER,
            [T, *U.T, *(THETA + 2 * np.pi * (T > 0.6)[:, None]).T],
            r"line 63: theta. jumps from .* the encoder wraps around",
        ),
        (
            HEADER,
            [T, *U.T, *np.rad2deg(THETA[:, :1]).T, *THETA[:, 1:].T],
            "check the units in the header",
        ),
        (HEADER, [T, U[:, 0], 0 * T, *THETA.T], "sign and order of the motors"),
        (HEADER, [T, U[:, 0], -U[:, 1], *THETA.T], r"not follow u2 \(correlation -1\.00\)"),
        (HEADER, [T, *U.T[::-1], *THETA.T], "check sign and order of the motors' columns"),
        (
            HEADER.replace("t_s", "time"),
            [T, *U.T, *THETA.T],
            r"column 'time' has no unit; write one of t_s, t_ms",
        ),
        (
            HEADER.replace("theta2_rad", "theta2"),
            [T, *U.T, *THETA.T],
            "'theta2' has no unit; write",
        ),
        (HEADER.replace("u2_rad_s", "u2_m_s"), [T, *U.T, *THETA.T], "'u2_m_s' has the unit 'm/s'"),
        (HEADER.replace("theta3_rad", "theta2_deg"), [T, *U.T, *THETA.T], "two columns for theta2"),
        (HEADER.replace("theta2", "theta4"), [T, *U.T, *THETA.T], "no column for theta2"),
        (HEADER.replace("u1_rad_s", "speed"), [T, *U.T, *THETA.T], r"no column for u1; .*'speed'"),
    ],
)
def test_what_cannot_be_used_is_refused_with_column_and_row(
    tmp_path: Path, header: str, columns: list, words: str
) -> None:
    path = write(tmp_path / "a.csv", header, *columns)
    with pytest.raises(InputError, match=words) as error:
        read_log(path)
    assert str(path) in str(error.value)


@pytest.fixture(scope="module")
def swung(paper: Problem) -> Log:
    return emulate_log(excitation(paper), Machine.prototype())


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_steps_of_an_encoder_are_named_by_line(swung: Log, tmp_path: Path, joint: int) -> None:
    """A joint turns by 0.35 degrees from row to row at most; each case was taken for motion."""
    for rows, deg in (((1500,), 3.0), ((1500,), 1.0), ((300, 900, 1700, 2400, 2900), 1.76)):
        theta = swung.theta.copy()
        for row in rows:
            theta[row:, joint] -= np.deg2rad(deg)
        path = replace(swung, theta=theta).save(tmp_path / "a.csv")
        with pytest.raises(InputError, match=rf"line {rows[0] + 2}: theta{joint + 1} "):
            read_log(path)


@pytest.mark.parametrize("rows", [slice(700, 1300), slice(700, 701), slice(3050, None)])
def test_a_reading_that_drops_to_zero_is_named(swung: Log, tmp_path: Path, rows: slice) -> None:
    theta = swung.theta.copy()
    theta[rows, 1] = 0.0
    path = replace(swung, theta=theta).save(tmp_path / "a.csv")
    with pytest.raises(InputError, match=rf"line {rows.start + 2}: theta2 "):
        read_log(path)


@pytest.mark.parametrize(
    "change",
    [{"encoder_noise_deg": 0.2}, {"encoder_resolution_deg": 1.0}, {"fidelity": "dynamic"}],
    ids=str,
)
def test_what_encoders_do_is_no_jump(paper: Problem, tmp_path: Path, change: dict) -> None:
    log = emulate_log(excitation(paper), Machine.prototype(**change))
    held = log.theta[np.arange(len(log.t)) // 5 * 5]  # read at 20 Hz, logged at 100 Hz
    slow = replace(log, t=log.t[::10], u=log.u[::10], theta=log.theta[::10])
    for each in (log, replace(log, theta=held), slow):
        assert len(read_log(each.save(tmp_path / "a.csv")).t) == len(each.t)


def test_an_empty_cell_and_an_empty_file_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", HEADER, T, *U.T, *THETA.T)
    lines = path.read_text("utf-8").splitlines()
    lines[9] = lines[9].rsplit(",", 1)[0] + ","
    path.write_text("\n".join(lines) + "\n", "utf-8")
    with pytest.raises(InputError, match=r"line 10: .*'theta3_rad'"):
        read_log(path)
    path.write_text("", "utf-8")
    with pytest.raises(InputError, match=r"a\.csv is empty"):
        read_log(path)


@pytest.mark.parametrize("place", [0, 1, 50])
def test_a_quotation_mark_without_an_end_is_refused(tmp_path: Path, place: int) -> None:
    """In the header, the first row or a later one: all to the next mark becomes one cell."""
    path = LOG.save(tmp_path / "a.csv")
    lines = path.read_text().splitlines()
    lines[place] += ',"' + "x" * 200_000 + '"'
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.csv .*131072"):
        read_log(path)


def test_rounded_times_are_even_and_jitter_stays(tmp_path: Path) -> None:
    jitter = T + 0.002 * np.sin(np.arange(len(T))) * (np.arange(len(T)) > 0)
    even = read_log(write(tmp_path / "a.csv", HEADER, np.round(T, 3), *U.T, *THETA.T))
    uneven = read_log(write(tmp_path / "b.csv", HEADER, jitter, *U.T, *THETA.T))
    assert even.is_even
    assert not uneven.is_even
    np.testing.assert_allclose(uneven.t, jitter, atol=1e-12)
    assert even.jitter_words == ""
    assert "b.csv: a tenth of the rows is 1.9 ms or more early or late" in uneven.jitter_words
    step = np.round(T / 1.2, 3)  # stamps in milliseconds, of 120 readings a second
    assert read_log(write(tmp_path / "c.csv", HEADER, step, *U.T, *THETA.T)).jitter_words == ""
    holes = np.arange(len(T)) % 20 != 7  # now and then a row was lost
    assert replace(LOG, t=T[holes], u=U[holes], theta=THETA[holes]).jitter_words == ""


def test_a_log_made_in_python_has_rows_of_numbers() -> None:
    for changes, words in (
        ({"u": U[:, :1]}, r"u has shape \(101, 1\); a log of R rows has"),
        ({"theta": THETA[:-1]}, r"theta has shape \(100, 3\)"),
        ({"theta": THETA[:, 0]}, r"theta has shape \(101,\)"),
        ({"theta": np.where(THETA > 0.09, np.nan, THETA)}, "theta has values that are NaN"),
    ):
        with pytest.raises(InputError, match=words):
            replace(LOG, **changes)


def test_a_part_begins_at_zero() -> None:
    part = LOG.part(0.25, 0.85)
    assert part.t[0] == 0
    assert part.t[-1] == pytest.approx(0.6)
    np.testing.assert_array_equal(part.theta, THETA[25:86])
    with pytest.raises(InputError, match=r"\b50\b"):
        LOG.part(0.8)


def test_a_log_in_place_of_a_plan_is_told_how_to_become_one() -> None:
    with pytest.raises(InputError, match=r"not a Plan; .* planner.replay\(log\.plan\(problem"):
        replay(LOG)  # type: ignore[arg-type]


def test_commands_of_a_log_move_the_machine_as_the_plan_did(paper: Problem) -> None:
    machine = Machine.prototype(encoder_resolution_deg=False).nominal()
    paper_plan = solve(paper, "collocation")
    planned = replay(paper_plan, machine)
    log = emulate_log(paper_plan, machine, noise_deg=0.0)
    again = replay(log.plan(paper), machine, settle_s=0.0)
    np.testing.assert_allclose(again.q[0, -1, 1:], planned.q[0, -1, 1:], atol=1e-6)
    assert again.index_E_deg[0] < 0.03  # between readings the log goes straight
    with pytest.raises(InputError, match=r" 3 joints .* 2\b"):
        log.plan(Problem.manipulator([5, 5], [20, 20]))
