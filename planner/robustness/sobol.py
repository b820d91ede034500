"""Sobol indices of the error index E: the share of its variance that each effect explains.

The variance of E is decomposed into parts of the effects and of their interactions (I. M. Sobol,
Math. Comput. Simul. 55, 2001, 271). First-order index: the expected share that disappears if the
effect is fixed. Total index: the share of the effect with all its interactions. Sampled and
estimated by SALib (J. Herman, W. Usher, J. Open Source Softw. 2, 2017, 97) with Saltelli's scheme;
all values of one effect (one per joint) are one group.

There are two sets of indices. *Between machines*: the factors are the quantiles of effects with a
spread; other effects stay constant. *On or off*: every effect is a factor that is off in one half
of the runs and at its mean in the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.machine import Draws, Machine, at_quantiles, draw, draw_start
from planner.problem.tables.machine_effects import EFFECTS
from planner.support.arrays import Array
from planner.support.package import how_to_install

CONFIDENCE = 0.95

INFINITY_FACTOR = 1e6
"""Factor for an infinite neutral value (a rigid shaft, no limit): the value is this times the
effect's value or 1, whichever is larger."""

SHARED_SWITCHES = ("delay_s", "servo_bandwidth_rad_s", "acceleration_limit_rad_s2")
"""Effects that are on or off for all samples of a simulation: with one common delay the time grid
contains every jump of the command, and without lag and ramp the command is integrated to a higher
order."""

QUANTILE_MARGIN = 1e-9
"""Least distance of quantiles from 0 and 1."""

Errors = Callable[[Machine, Draws], Array]
"""Function that simulates drawn machines and returns the error E of each, (S,), degrees."""


@dataclass(frozen=True)
class Index:
    """Sobol indices of one effect, as shares of the variance of E.

    Attributes:
        first: First-order index.
        first_half: Half of the 95 % interval of `first` (bootstrap).
        total: Total index.
        total_half: Half of the 95 % interval of `total` (bootstrap).
    """

    first: float
    first_half: float
    total: float
    total_half: float


def machine_indices(
    machine: Machine, names: Sequence[str], joints: int, errors: Errors, base: int, seed: int
) -> dict[str, Index]:
    """Return the Sobol indices of the effects that differ between machines, by effect.

    Args:
        machine: The distribution of machines.
        names: The effects to consider.
        joints: Number of coordinates without the first, N−1.
        errors: Simulates single machines; see `Errors`.
        base: Number of base samples, a power of 2; (effects + 2) · base machines are simulated.
        seed: Seed of the samples and of the bootstrap.
    """

    def evaluate(places: Mapping[str, Array]) -> Array:
        count = next(iter(places.values())).shape[1]
        values = {}
        for name, quantity in machine.effects.items():
            middle = np.full((EFFECTS[name].count(joints), count), 0.5)
            values[name] = at_quantiles(name, quantity, joints, places.get(name, middle))
        numbers = np.arange(count)
        start = draw_start(machine, joints, numbers, seed)
        return errors(machine, Draws(numbers, values, start, seed))

    sizes = {k: EFFECTS[k].count(joints) for k in names if machine.effects[k].varies}
    return indices(sizes, evaluate, base, seed)


def switch_indices(
    machine: Machine, names: Sequence[str], joints: int, errors: Errors, base: int, seed: int
) -> dict[str, Index]:
    """Return the Sobol indices of each effect as a switch; arguments as for `machine_indices`."""
    nominal = machine.nominal()

    def evaluate(places: Mapping[str, Array]) -> Array:
        off = {name: place[0] < 0.5 for name, place in places.items()}
        numbers = np.arange(len(next(iter(off.values()))))
        return switched_errors(nominal, off, numbers, joints, errors, seed)

    return indices(dict.fromkeys(names, 1), evaluate, base, seed)


def check(base: int) -> None:
    """Refuse a missing SALib or a wrong `base`; call this before the replays.

    Raises:
        InputError: If SALib is missing or `base` is not a power of 2.
    """
    if base < 2 or base & (base - 1):
        raise InputError(f"base = {base}: must be a power of 2, such as 128 or 256")
    find_salib()


def indices(
    sizes: Mapping[str, int], evaluate: Callable[[Mapping[str, Array]], Array], base: int, seed: int
) -> dict[str, Index]:
    """Return the Sobol indices of groups of independent factors that are uniform on [0, 1].

    Args:
        sizes: Number of factors of each group.
        evaluate: Function of the factors of each group, (size, S), that returns the output, (S,).
        base: As for `machine_indices`.
        seed: Seed of the samples and of the bootstrap.

    Raises:
        InputError: If SALib is missing or `base` is not a power of 2.
    """
    check(base)
    sample, analyze = find_salib()
    if not sizes:
        return {}
    owner = [name for name, size in sizes.items() for _ in range(size)]
    problem: dict[str, Any] = {
        "num_vars": len(owner),
        "names": [f"{name} {k}" for k, name in enumerate(owner)],
        "bounds": [[QUANTILE_MARGIN, 1 - QUANTILE_MARGIN]] * len(owner),
    }
    if len(sizes) > 1:
        problem["groups"] = owner
    places = sample(problem, base, calc_second_order=False, seed=seed)
    columns = {name: places[:, [k for k, o in enumerate(owner) if o == name]].T for name in sizes}
    output = evaluate(columns)
    if np.ptp(output) == 0:
        return dict.fromkeys(sizes, Index(0.0, 0.0, 0.0, 0.0))
    if len(sizes) == 1:  # a single effect explains all variance
        return dict.fromkeys(sizes, Index(1.0, 0.0, 1.0, 0.0))
    # SALib treats seed 0 as no seed.
    result = analyze(problem, output, calc_second_order=False, conf_level=CONFIDENCE, seed=seed + 1)
    rows = zip(*(result[key] for key in ("S1", "S1_conf", "ST", "ST_conf")), strict=True)
    return {name: Index(*map(float, row)) for name, row in zip(sizes, rows, strict=True)}


def switched_errors(
    machine: Machine,
    off: Mapping[str, Array],
    numbers: NDArray[np.int64],
    joints: int,
    errors: Errors,
    seed: int,
) -> Array:
    """Return E of samples of a machine, (S,), each with its own effects switched off.

    Args:
        machine: The distribution of machines.
        off: Whether each effect is off, (S,), by its name.
        numbers: Numbers of the samples, (S,).
        joints: Number of coordinates without the first, N−1.
        errors: Simulates single machines; see `Errors`.
        seed: Seed of the samples.
    """
    out = np.empty(len(numbers))
    for shared, rows in _patterns(off):
        reduced = machine.without(*shared)
        draws = draw(reduced, joints, numbers[rows], seed)
        out[rows] = errors(reduced, switch_off(draws, {k: f[rows] for k, f in off.items()}))
    return out


def _patterns(off: Mapping[str, Array]) -> list[tuple[list[str], NDArray[np.int64]]]:
    """Group the samples that can share a simulation.

    Return for each group the effects that are off in its whole simulation, and the indices of its
    samples. `off` says for each effect on which samples it is off, (S,).
    """
    shared = [name for name in off if not switches_per_sample(name)]
    count = len(next(iter(off.values())))
    flags = np.stack([off[name] for name in shared]) if shared else np.zeros((1, count), dtype=bool)
    kinds, which = np.unique(flags, axis=1, return_inverse=True)
    which = which.ravel()
    return [
        ([n for n, is_off in zip(shared, kind, strict=False) if is_off], np.flatnonzero(which == k))
        for k, kind in enumerate(kinds.T)
    ]


def switches_per_sample(name: str) -> bool:
    """Return whether an effect can be on or off for each sample of a simulation separately."""
    effect = EFFECTS[name]
    return effect.may_spread and not np.isnan(effect.off_value) and name not in SHARED_SWITCHES


def switch_off(draws: Draws, off: Mapping[str, Array]) -> Draws:
    """Return drawn machines with some effects at their neutral values, that is, switched off.

    Args:
        draws: S machines with all their effects.
        off: Mask (S,) of the machines on which each effect is off, by effect; effects that all
            machines of a simulation share stay on.
    """
    values = {}
    for name, drawn in draws.values.items():
        effect = EFFECTS[name]
        endless = np.isinf(effect.off_value)
        neutral = INFINITY_FACTOR * np.maximum(drawn, 1.0) if endless else effect.off_value
        flags = off.get(name) if switches_per_sample(name) else None
        values[name] = drawn if flags is None else np.where(flags, neutral, drawn)
    return replace(draws, values=values)


def find_salib() -> tuple[Any, Any]:
    """Return SALib's functions that sample and analyse; call this before long work, too.

    Raises:
        InputError: If SALib is missing.
    """
    try:
        from SALib.analyze import sobol as analysis
        from SALib.sample import sobol as sampling
    except ImportError:
        raise InputError(
            f"Sobol indices need SALib; install it with: {how_to_install('budget')}"
        ) from None
    return sampling.sample, analysis.analyze
