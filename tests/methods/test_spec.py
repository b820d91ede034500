"""Methods with options in one line."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner.methods.registry import parse_spec, parse_specs
from planner.support.files import toml, toml_lines


def test_a_bare_name_has_no_options() -> None:
    assert parse_spec("collocation compensated:intervals=20").compensated
    assert parse_spec(" collocation  compensated ").method == "collocation"
    assert not parse_spec("collocation").compensated
    spec = parse_spec(" polynomial ")
    assert (spec.label, spec.method, spec.options) == ("polynomial", "polynomial", {})


def test_values_are_toml_and_plain_words_are_strings() -> None:
    spec = parse_spec("polynomial:travel=middle:points=[[5.0, -0.2]]:allow_singular=true:offset=1")
    assert spec.options == {
        "travel": "middle",
        "points": [[5.0, -0.2]],
        "allow_singular": True,
        "offset": 1,
    }
    assert spec.label.startswith("polynomial:travel=middle")


def test_separators_inside_quotes_and_brackets_do_not_separate(paper: planner.Problem) -> None:
    specs = parse_specs(paper, "polynomial:points=[[5.0, -0.2], [6.0, -0.3]],polynomial")
    assert [spec.method for spec in specs] == ["polynomial", "polynomial"]
    assert parse_spec("polynomial:travel='a:b'").options == {"travel": "a:b"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("polynomail", r"unknown method 'polynomail'.*did you mean 'polynomial'"),
        ("", "unknown method"),
        ("polynomial:travel", "'travel' is not key=value"),
        ("polynomial:=middle", "not key=value"),
        ("polynomial:travel=", "not key=value"),
        ("polynomial:travel=middle:travel=auto", "'travel' is given twice"),
        ("polynomial:points=[[5,", "'points'"),
        ("polynomial:travel=1 2", "'travel' = 1 2 is not a value"),
    ],
)
def test_bad_specs_are_named(text: str, said: str) -> None:
    with pytest.raises(planner.InputError, match=said):
        parse_spec(text)


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ([], "no method named"),
        (["polynomial", "polynomial"], "'polynomial' is named twice"),
        (["polynomial:travle=middle"], r"travle.*did you mean 'travel'"),
        (["polynomial:travel=sideways"], "sideways"),
    ],
)
def test_bad_lists_and_options_are_refused_before_any_work(
    paper: planner.Problem, texts: list[str], said: str
) -> None:
    with pytest.raises(planner.InputError, match=said):
        parse_specs(paper, texts)
    with pytest.raises(planner.InputError, match=said):
        parse_specs(paper, (text for text in texts))


VALUES = st.recursive(
    st.booleans()
    | st.integers(-(10**9), 10**9)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs", "Cc"])),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.from_regex(r"[a-z_]{1,8}", fullmatch=True), inner, max_size=3)
    ),
    max_leaves=4,
)


def test_specs_may_come_one_by_one(paper: planner.Problem) -> None:
    names = ["polynomial", "convex"]
    assert parse_specs(paper, iter(names)) == parse_specs(paper, names)


def test_every_call_that_names_a_method_takes_a_spec(paper: planner.Problem) -> None:
    quick = paper.changed({"machine.step_s": 0.01})
    plan = planner.solve(quick, "polynomial:points=auto")
    same = planner.solve(quick, "polynomial", points="auto")
    assert plan.to_dict()["trajectory"] == same.to_dict()["trajectory"]
    keyword_wins = planner.solve(quick, "polynomial:points=[[5.0,0.5]]", points="auto")
    assert keyword_wins.options == plan.options
    commands = planner.solve(quick, "polynomial compensated:points=auto")
    assert commands.compensates is not None
    assert commands.compensates.options == plan.options
    analysis = planner.check(quick, "polynomial,polynomial:points=auto")
    assert [(o["label"], o["verified"]) for o in analysis.outcomes] == [
        ("polynomial", False),
        ("polynomial:points=auto", True),
    ]
    found = planner.sensitivities({"its path": plan, "its commands": commands})
    assert len(set(found.passive_block_deg.values())) == 1


def test_only_a_comparison_takes_a_plan_with_feedback(paper: planner.Problem) -> None:
    assert parse_spec("collocation + feedback", feedback=True).feedback
    with pytest.raises(planner.InputError):
        parse_specs(paper, ["collocation + feedback"])
    with pytest.raises(planner.InputError):
        planner.solve(paper, "collocation + feedback")


@given(VALUES)
def test_toml_text_reads_back_as_the_value(value: object) -> None:
    assert tomllib.loads(f"x = {toml(value)}") == {"x": value}
    tables = {"x": value, "a b": {"x": value, "c": {"x": value}}, "d": [{"x": value}, {"e": {}}]}
    assert tomllib.loads("\n".join(toml_lines(tables))) == tables


@pytest.mark.parametrize("key", ["advice", "compensate", "compensated_for", "options"])
def test_no_key_but_a_method_s_own_is_an_option(paper: planner.Problem, key: str) -> None:
    with pytest.raises(planner.InputError, match=f"'{key}' .*: criterion"):
        planner.solve(paper, "polynomial", **{key: False})
