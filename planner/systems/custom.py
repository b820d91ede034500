"""A triangular system whose functions fᵢ and γ the user gives, as text or as Python functions.

The functions `check_…` raise an error that names the fault if the input is not in triangular form.
"""

from __future__ import annotations

import keyword
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from planner.errors import InputError
from planner.support.arrays import Array
from planner.support.calculus.inverse import Preimage, inverse
from planner.support.casadi import ca
from planner.support.compiled_calls import Pointwise
from planner.systems.expressions import FUNCTIONS, parse_expression, write_expression
from planner.systems.triangular_system import Coordinate, TriangularSystem
from planner.systems.user_map import UserMap

Slopes = Callable[[Any], Sequence[Any]] | Sequence[str]
Drive = Callable[[Any], Any] | str

_INPUTS = (Coordinate("u1", ""), Coordinate("u2", ""))


class CustomSystem(TriangularSystem):
    """A triangular system whose functions fᵢ and γ the user gives.

    q̇₁ = γ(q) u₁,  q̇₂ = u₂,  q̇ᵢ = fᵢ(qᵢ₋₁, qᵢ, …, q_N) q̇₁  (i = 3 … N).

    Each fᵢ must be strictly monotone in qᵢ₋₁ on that coordinate's interval, or have one extremum
    there; the branch is the side of the extremum on which the start lies. The inverse of the
    chained form solves one scalar equation per fᵢ, by Newton's method safeguarded by bisection.
    Unlike in other systems, the numeric form is computed from the symbolic form, so the two forms
    do not check each other.

    Args:
        name: Name of the system.
        coordinates: The N ≥ 3 coordinates in triangular order; names are Python identifiers.
        slopes: f₃ … f_N: a function from the CasADi vector q (N) to N−2 expressions, or N−2 texts
            in the coordinates' names ("tan(theta) / cos(phi)").
        drive: γ in the same form; by default 1.
        intervals: Open interval of each coordinate q₂ … q_{N−1}, by name, in its unit. The default
            for angles (unit "rad") is (−π/2, π/2).
        inputs: Names and units of u₁ and u₂.
        user: User coordinates, if they differ from the triangular coordinates: a table with
            `coordinates` (their N names), `units`, `expressions` (N texts in the triangular names)
            and `inverse` (N texts in the user's names, one for each triangular coordinate).

    Raises:
        InputError: If names or counts do not match, fᵢ depends on a coordinate before qᵢ₋₁ or not
            on qᵢ₋₁, an interval is missing or empty, fᵢ has more than one extremum in it, or the
            map to the user coordinates and its inverse do not match.
    """

    kind: ClassVar[str] = "custom"

    def __init__(
        self,
        name: str,
        coordinates: Sequence[Coordinate],
        slopes: Slopes,
        drive: Drive = "1.0",
        *,
        intervals: Mapping[str, Sequence[float]] | None = None,
        inputs: tuple[Coordinate, Coordinate] = _INPUTS,
        user: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self.name = name
        self._coordinates = check_names(name, coordinates)
        self._inputs = (inputs[0], inputs[1])
        self._intervals = check_intervals(name, self._coordinates, intervals or {})
        self._slopes_text = self._expression_texts("slopes", slopes)
        self._drive_text = self._expression_texts("drive", drive)[0]
        self._user = None if user is None else UserMap(name, self._coordinates, user)
        self._build()

    # -- names ---------------------------------------------------------------------------------

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates passed to the constructor."""
        return self._coordinates

    @property
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        """The inputs passed to the constructor."""
        return self._inputs

    @property
    def user_coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates of the argument `user`; without it, the triangular coordinates."""
        return self._coordinates if self._user is None else self._user.coordinates

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Open interval of each coordinate except the first and the last, in its unit, by name."""
        return {self._coordinates[i].name: pair for i, pair in self._intervals.items()}

    # -- symbolic form -------------------------------------------------------------------------

    def slopes_expr(self, q: Any) -> list[Any]:
        """Return the slopes f₃ … f_N as CasADi expressions in q (N), from the user's texts."""
        return [self._parse(f"slopes[{k}]", s, q) for k, s in enumerate(self._slopes_text)]

    def drive_expr(self, q: Any) -> Any:
        """Return the factor γ in q̇₁ = γ(q) u₁ as a CasADi expression in q (N)."""
        return self._parse("drive", self._drive_text, q)

    def user_expr(self, q: Any) -> list[Any]:
        """Return the N user coordinates as CasADi expressions in the triangular ones, q (N)."""
        return super().user_expr(q) if self._user is None else self._user.there(q)

    def from_user_expr(self, w: Any) -> list[Any]:
        """Return the N coordinates q as CasADi expressions in the user coordinates w (N)."""
        return super().from_user_expr(w) if self._user is None else self._user.back(w)

    # -- the chart -----------------------------------------------------------------------------

    def branch(self, q: Array) -> Array:
        """Return the sign of ∂fᵢ₊₁/∂qᵢ for each i, (N,); 0 at an extremum or off the interval."""
        out = np.ones(self.size)
        point = np.nan_to_num(np.asarray(q, dtype=float))
        for i, (low, high) in self._intervals.items():
            derivative = float(self._links[i](point)[1])
            inside = low < point[i] < high and abs(derivative) > 1e-12
            out[i] = np.sign(derivative) if inside else 0.0
        return out

    def link_from_slope(self, i: int, slope: Array, q: Array, branch: Array) -> Array:
        """Return the qᵢ of the given branch for which fᵢ₊₁ = slope, shape (…,); NaN if none."""
        solution, _ = self._solve_link(i, slope, q, branch)
        return np.where(solution.exists, solution.x, np.nan).reshape(np.shape(slope))

    def link_margins(self, i: int, slope: Array, q: Array, branch: Array) -> list[Array]:
        """Return three margins of the solution qᵢ of fᵢ₊₁ = slope, each (…,).

        Two are the distances from the interval's ends, as shares of its width; the third is
        ∂fᵢ₊₁/∂qᵢ times the branch's sign. Without a solution, the violated margin is minus the
        amount by which the slope is out of range.
        """
        solution, derivative = self._solve_link(i, slope, q, branch)
        (low, high), x = self._intervals[i], solution.x
        missing = np.isnan(x) & ~np.isnan(np.ravel(slope))  # no point has the sign of the branch
        pairs = [
            ((x - low) / (high - low), solution.short_low),
            ((high - x) / (high - low), solution.short_high),
            (np.where(missing, -1.0, derivative), solution.short_turn),
        ]
        return [np.where(s > 0, -s, m).reshape(np.shape(slope)) for m, s in pairs]

    def chart_margins(self, q: Array, branch: Array) -> Array:
        """Return the three margins of each of q₂ … q_{N−1}, shape (…, 3(N−2)), at q (…, N)."""
        out = []
        for i, (low, high) in self._intervals.items():
            derivative = self._links[i](q)[..., 1]
            out += [(q[..., i] - low) / (high - low), (high - q[..., i]) / (high - low)]
            out.append(branch[i] * derivative)
        return np.stack(out, axis=-1)

    def chart_margins_expr(self, q: Any, branch: Array) -> list[Any]:
        """Return the margins of `chart_margins` as CasADi expressions in q (N)."""
        slopes, out = self.slopes_expr(q), []
        for i, (low, high) in self._intervals.items():
            derivative = ca.jacobian(slopes[i - 1], q)[0, i]
            out += [(q[i] - low) / (high - low), (high - q[i]) / (high - low)]
            out.append(float(branch[i]) * derivative)
        return out

    @property
    def margin_labels(self) -> tuple[tuple[int, str], ...]:
        """Array index of the coordinate and meaning of each margin, ordered as `chart_margins`."""
        labels = []
        for i, (low, high) in self._intervals.items():
            this, following = self._coordinates[i].name, self._coordinates[i + 1].name
            labels.append((i, f"distance of {this} from {low:.6g}, share of its interval"))
            labels.append((i, f"distance of {this} from {high:.6g}, share of its interval"))
            labels.append((i, f"derivative of the slope of {following} by {this}"))
        return tuple(labels)

    def _solve_link(self, i: int, slope: Array, q: Array, branch: Array) -> tuple[Preimage, Array]:
        """Return the solution qᵢ of fᵢ₊₁ = slope, and ∂fᵢ₊₁/∂qᵢ times the branch's sign."""
        points = np.where(np.arange(self.size) > i, q, 0.0).reshape(-1, self.size)

        def function(x: Array) -> tuple[Array, Array]:
            points[:, i] = x
            f, derivative = self._links[i](points).T
            return f, derivative

        solution = inverse(function, np.ravel(slope), *self._intervals[i], branch[i])
        return solution, branch[i] * function(solution.x)[1]

    # -- construction --------------------------------------------------------------------------

    def _parse(self, what: str, text: str, q: Any) -> Any:
        symbols = {c.name: q[i] for i, c in enumerate(self._coordinates)}
        return parse_expression(text, symbols, f"{self.name}: {what}")

    def _expression_texts(self, what: str, given: Any) -> list[str]:
        """Return the texts of "slopes" or "drive", given as texts or as a function of q."""
        symbols = [ca.SX.sym(c.name) for c in self._coordinates]
        values = given(ca.vertcat(*symbols)) if callable(given) else given
        parts = [values] if what == "drive" else list(values)
        if what == "slopes" and len(parts) != self.size - 2:
            raise InputError(
                f"{self.name}: {self.size} coordinates need {self.size - 2} slopes,"
                f" not {len(parts)}"
            )
        where = f"{self.name}: {what}"
        return [p if isinstance(p, str) else write_expression(p, where) for p in parts]

    def _build(self) -> None:
        q = ca.SX.sym("q", self.size)
        slopes = [ca.SX(s) for s in self.slopes_expr(q)]
        self.drive_expr(q)  # raise an error now if its text is wrong
        self._links = {
            i: Pointwise(f"link{i}", [q], ca.vertcat(f, ca.jacobian(f, q[i])))
            for i, f in enumerate(slopes, start=1)
        }
        check_structure(self.name, self._coordinates, slopes, q)
        check_turns(self.name, self._coordinates, self._intervals, self._links)
        if self._user is not None:
            check_names(self.name, self._user.coordinates)
            self._user.check_inverse(self._intervals)

    # -- identity ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Return the `[system]` table of a problem file."""
        user = {} if self._user is None else {"user": self._user.texts}
        return {
            "kind": self.kind,
            "name": self.name,
            "coordinates": [c.name for c in self._coordinates],
            "units": [c.unit for c in self._coordinates],
            "slopes": list(self._slopes_text),
            "drive": self._drive_text,
            "intervals": {name: list(pair) for name, pair in self.intervals.items()},
            "inputs": [c.name for c in self._inputs],
            "input_units": [c.unit for c in self._inputs],
            **user,
        }


Intervals = Mapping[int, tuple[float, float]]


def check_names(system: str, coordinates: Sequence[Coordinate]) -> tuple[Coordinate, ...]:
    """Return the coordinates after checking that there are at least three, with usable names.

    Raises:
        InputError: If there are too few coordinates, or a name is unusable or appears twice.
    """
    names = [c.name for c in coordinates]
    if len(names) < 3:
        raise InputError(f"{system}: {len(names)} coordinates; a triangular system has at least 3")
    for name in names:
        if not name.isidentifier() or keyword.iskeyword(name) or name in FUNCTIONS or name == "pi":
            raise InputError(f"{system}: {name!r} cannot be the name of a coordinate")
        if names.count(name) > 1:
            raise InputError(f"{system}: two coordinates are called {name!r}")
    return tuple(coordinates)


def check_intervals(
    system: str, coordinates: Sequence[Coordinate], given: Mapping[str, Sequence[float]]
) -> dict[int, tuple[float, float]]:
    """Return the interval of each coordinate except the first and the last, by array index.

    Raises:
        InputError: If an interval is missing, empty or not finite, or is given for the first or
            last coordinate or an unknown name.
    """
    links = {c.name: i for i, c in enumerate(coordinates) if 0 < i < len(coordinates) - 1}
    unknown = [name for name in given if name not in links]
    if unknown:
        raise InputError(
            f"{system}: intervals of {', '.join(unknown)}: only {', '.join(links)} have one"
        )
    out = {}
    for name, i in links.items():
        if name not in given and coordinates[i].unit != "rad":
            raise InputError(f"{system}: give the interval of {name} in {coordinates[i].unit}")
        low, high = (float(x) for x in given.get(name, (-np.pi / 2, np.pi / 2)))
        if not (np.isfinite(high - low) and low < high):
            ends = "the ends must be finite, the lower one first"
            raise InputError(f"{system}: the interval of {name} is ({low:g}, {high:g}); {ends}")
        out[i] = (low, high)
    return out


def check_structure(system: str, coordinates: Sequence[Coordinate], slopes: Any, q: Any) -> None:
    """Refuse a slope fᵢ that depends on a coordinate before qᵢ₋₁, or does not depend on qᵢ₋₁.

    Raises:
        InputError: If there is such a slope; the message names its coordinates.
    """
    names = [c.name for c in coordinates]
    for link, slope in enumerate(slopes, start=1):
        reads = [bool(ca.depends_on(slope, q[j])) for j in range(len(names))]
        coordinate = names[link + 1]
        early = [names[j] for j in range(link) if reads[j]]
        if early:
            raise InputError(
                f"{system}: the slope of {coordinate} depends on {', '.join(early)}; in"
                f" triangular form it may depend on {', '.join(names[link:])} only"
            )
        if not reads[link]:
            raise InputError(
                f"{system}: the slope of {coordinate} does not depend on {names[link]}, so the"
                " chain is broken there"
            )


def check_turns(
    system: str, coordinates: Sequence[Coordinate], intervals: Intervals, links: Mapping[int, Any]
) -> None:
    """Refuse a slope fᵢ₊₁ whose derivative by qᵢ changes sign more than once on qᵢ's interval.

    The test samples qᵢ on a grid, at a few random values (fixed seed) of the other coordinates.

    Raises:
        InputError: If there is such a slope; the message names its coordinates.
    """
    rng = np.random.default_rng(0)
    for i, (low, high) in intervals.items():
        for _ in range(5):
            points = np.tile(rng.uniform(-1, 1, len(coordinates)), (201, 1))
            for j, (a, b) in intervals.items():
                points[:, j] = rng.uniform(a, b)
            points[:, i] = np.linspace(low, high, 203)[1:-1]
            signs = np.sign(links[i](points)[:, 1])
            signs = signs[(signs != 0) & np.isfinite(signs)]
            if sum(a != b for a, b in pairwise(signs)) > 1:
                raise InputError(
                    f"{system}: the slope of {coordinates[i + 1].name} has more than one"
                    f" extremum for {coordinates[i].name} in ({low:g}, {high:g});"
                    " give a narrower interval"
                )
