"""One of every system, for tests that must hold on all of them."""

from __future__ import annotations

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from planner import (
    BallGear,
    Car,
    Coin,
    CustomSystem,
    Manipulator,
    Trailers,
    TriangularSystem,
    Unicycle,
)

_K = [0.870125, 0.711625, 0.9, 0.6, 1.2]


def _copy(system: TriangularSystem) -> CustomSystem:
    """The same system as a user would give it: by its expressions alone."""
    return CustomSystem(
        f"copy of {system.kind}", system.coordinates, system.slopes_expr, system.drive_expr
    )


def _coin_in_texts(r: float) -> CustomSystem:
    """The coin with the map to its user's coordinates as texts."""
    coin, ahead = Coin(r), f"(sigma + {r} * roll)"
    user = {
        "coordinates": [c.name for c in coin.user_coordinates],
        "units": [c.unit for c in coin.user_coordinates],
        "expressions": [
            f"{ahead} * cos(heading) + eta * sin(heading)",
            f"{ahead} * sin(heading) - eta * cos(heading)",
            "heading",
            "roll",
        ],
        "inverse": [
            "heading",
            "roll",
            "x * sin(heading) - y * cos(heading)",
            f"x * cos(heading) + y * sin(heading) - {r} * roll",
        ],
    }
    wide = {"roll": (-50.0, 50.0), "eta": (-50.0, 50.0)}
    slopes = [ahead, "-eta"]
    return CustomSystem("coin", coin.coordinates, slopes, intervals=wide, user=user)


MANIPULATORS = {f"manipulator-{n}": Manipulator(_K[: n - 1], 0.668811) for n in range(2, 7)}

SYSTEMS: dict[str, TriangularSystem] = {
    **MANIPULATORS,
    **{f"ball-gear-{n}": BallGear(_K[: n - 1], 0.8) for n in range(2, 6)},
    "unicycle": Unicycle(),
    "car": Car(2.7),
    "coin": Coin(0.3),
    **{f"trailers-{n}": Trailers([2.0, 1.2, 1.6][:n], 1.5) for n in range(1, 4)},
    "custom-coin": _coin_in_texts(0.3),
    "custom-manipulator-3": _copy(Manipulator(_K[:2])),
    "custom-trailers-1": _copy(Trailers([2.0], 1.5)),
}

NAMES = sorted(SYSTEMS)

few = settings(max_examples=20)
"""For what holds on sixteen systems: that many examples on each are 320 of the property."""


@st.composite
def points(
    draw: st.DrawFn, system: TriangularSystem, low: float = 0.1, high: float = 1.3
) -> np.ndarray:
    """A configuration with every link's angle between `low` and `high` rad, either sign."""
    size = system.size
    free = draw(st.lists(st.floats(-2, 2), min_size=2, max_size=2))
    angles = draw(st.lists(st.floats(low, high), min_size=size - 2, max_size=size - 2))
    signs = draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=size - 2, max_size=size - 2))
    return np.array([free[0], *(np.array(angles) * signs), free[1]])


inputs = st.lists(st.floats(-2, 2), min_size=2, max_size=2).map(np.array)
