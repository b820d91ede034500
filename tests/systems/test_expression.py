import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from planner import InputError
from planner.systems.expressions import FUNCTIONS, parse_expression, write_expression

A, B = ca.SX.sym("a"), ca.SX.sym("b")
SYMBOLS = {"a": A, "b": B}

leaves = st.sampled_from(["a", "b", "pi"]) | st.floats(0.01, 9).map(repr) | st.just("3")
texts = st.recursive(
    leaves,
    lambda inner: (
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "**"]), inner).map(
            lambda parts: f"({parts[0]} {parts[1]} {parts[2]})"
        )
        | st.tuples(st.sampled_from(sorted(set(FUNCTIONS) - {"atan2"})), inner).map(
            lambda parts: f"{parts[0]}({parts[1]})"
        )
        | st.tuples(inner, inner).map(lambda parts: f"atan2({parts[0]}, -{parts[1]})")
    ),
    max_leaves=8,
)


@given(text=texts)
def test_what_is_written_reads_back_bit_by_bit(text: str) -> None:
    try:
        expression = ca.SX(parse_expression(text, SYMBOLS))
    except InputError as error:  # acos(3), say
        assume("no finite value" not in str(error))
        raise
    again = parse_expression(write_expression(expression), SYMBOLS)
    both = ca.Function("both", [A, B], [expression, ca.SX(again)])
    first, second = (float(v) for v in both(0.3, 1.7))
    np.testing.assert_array_equal(first, second)


def test_precedence_is_pythons() -> None:
    value = ca.Function("f", [A, B], [parse_expression("-a**2 + b/2*3 - +1", SYMBOLS)])
    assert float(value(3.0, 4.0)) == -9 + 6 - 1


@pytest.mark.parametrize(
    "text",
    [
        *["a.b", "a[0]", "lambda: a", "a if b else 1", "[a]", "'a'", "True", "f(a)", "sin(a, b)"],
        *["sin(x=a)", "a < b", "", "a b", "1/0", "a @ b", "().__class__", "atan2(a)", "acos(3)"],
    ],
)
def test_everything_else_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="where"):
        parse_expression(text, SYMBOLS, "where")


def test_zero_and_unknown_operations() -> None:
    assert write_expression(ca.SX(0)) == "0.0"
    with pytest.raises(InputError, match="cannot be written"):
        write_expression(ca.fmax(A, B))
