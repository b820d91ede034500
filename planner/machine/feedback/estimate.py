"""State estimation from the encoders: the coordinates, and the lost motion of each passive joint.

A passive joint follows its axis a at the distance of its lost motion w (backlash and the twist of
its shaft): θ = a − w while the axis pushes it up, θ = a + w while it pushes it down, and it rests
in between. The axis moves (1 + ε) times as far as forecast; ε is the error of its ratio, caused by
gears and by contacts that slip more or less than the mean machine's. A Kalman filter (B. D. O.
Anderson, J. B. Moore, *Optimal Filtering*, 1979, section 3.1) with the states a, w and ε estimates
all three: a moving joint gives a ∓ w; a joint that rests although its axis should have reached it
shows a larger lost motion. After a joint has been pushed in both directions, its lost motion is
known.

A reading gives an interval of one encoder step for the angle, so the estimate is moved into that
interval and not further (F. C. Schweppe, *Recursive state estimation: unknown but bounded errors
and system inputs*, IEEE Transactions on Automatic Control 13, 1968). Thus an angle in motion is
known better than its encoder's resolution.

Encoders with noise: a resting joint is where the mean of its readings is (a scalar Kalman filter),
and counts as pushed once a reading differs from that mean by more than half an encoder step and
`PUSHED_SPREADS` standard deviations. A reading that jumps further than its axis can have moved it
counts only if the next one is there, too.

The module also predicts the effect of commands already sent, on the nominal machine. Commands act
after the known delay and lag; a motor that reverses first crosses the mean backlash of its
gearhead, and an axis that of its joint. Feedback corrects all other effects of the machine. Since
the systems are driftless, only the commanded angle of each motor matters, not its timing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem

RATE_SPREAD = 0.01
"""Expected standard deviation of ε, the relative error of a joint's rate."""

LOST_SPREAD = 0.2
"""Expected standard deviation of lost motion, and of an axis's start position in it, as a fraction
of mean lost motion: the result of 20 % each of backlash and friction and 10 % of stiffness."""

ROUNDING_VARIANCE_FACTOR = 2.0
"""Factor on the variance of encoders' rounding: slow joints stay in one encoder step for long."""

UNMODELLED_SPREAD_RAD = float(np.deg2rad(0.003))
"""Standard deviation of an axis's unmodelled motion per period, rad."""

NOISE_SHARE = 1 / 3
"""Further unmodelled motion of an axis per period, as a fraction of the noise of its encoder."""

REST_SHARE = 1 / 15
"""Motion of a resting joint per period for which the mean of its readings allows, as a fraction of
the noise. With more, the mean follows a joint that is pushed slowly, which then seems to rest."""

PUSHED_SPREADS = 4.5
"""Deviation of a reading from the mean of a resting joint at which its axis pushes the joint, in
standard deviations beyond half an encoder step: one reading in 300,000 deviates as much by chance.
With 4 some machines are 3.5 degrees off; with 6 the push is noticed later."""

UNKNOWN_VARIANCE = 1.0
"""Variance of a joint's position before its first reading, rad²."""

EXACT_READING_SPREAD = 1e-9
"""Standard deviation of a reading without resolution, in the coordinate's unit."""

SETTLING_SHARE = 0.04
"""Error of a reading while servos settle, as a fraction of the change of an axis's travel from one
period to the next; the model has only the lag of the servos. With 0 instead, the estimated play of
motor 2's gearhead is wrong by 0.1 degrees, and E is 0.24 degrees instead of 0.21 (95 %)."""

FITTING_SPREADS = 3.0
"""Largest error of a plausible reading, in standard deviations."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Positions of joints, axes and motor 1 of S samples.

    Attributes:
        q: Coordinates, (N, S).
        axis: Angles of the joints' axes, (N−1, S), on the joints' scale; joint 1's axis is motor 2.
        side: Position of motor 1 in its gearhead's play, (S,), rad.
    """

    q: Array
    axis: Array
    side: Array


SWING_SPREAD_RAD = float(np.deg2rad(0.3))
"""Standard deviation of the swing of links with inertia on their shafts, rad. With 0 the filter
takes swings for lost motion and errors of ratios, and the error at the end is 0.59 degrees instead
of 0.29 (95 %)."""


def reading_variance(resolution: Array, noise: Array, swings: bool) -> Array:
    """Return the variance of each joint's encoder reading, (N−1, 1).

    Args:
        resolution: Resolution of all readings, (N, 1).
        noise: Standard deviation of their noise, (N, 1).
        swings: Whether links swing on their shafts.
    """
    rounding = ROUNDING_VARIANCE_FACTOR * resolution[1:] ** 2 / 12 + EXACT_READING_SPREAD**2
    return rounding + noise[1:] ** 2 + swings * SWING_SPREAD_RAD**2


class StateEstimate:
    """Estimate of positions, lost motion and rate errors of S samples.

    Args:
        q: Coordinates expected at the start, (N, S).
        resolution: Resolution of each reading, (N, 1), in the coordinates' units; 0 means exact,
            infinite means not measured.
        noise: Standard deviation of the noise of each reading, (N, 1).
        lost_motion: Mean lost motion of each joint, (N−1, 1).
        variance: Variance of each joint's reading, (N−1, 1).

    Attributes:
        pose: Estimated positions.
        lost_motion: Estimated lost motion of each joint, (N−1, S).
        rate_error: Estimated relative error ε of each joint's rate, (N−1, S).
    """

    def __init__(
        self, q: Array, resolution: Array, noise: Array, lost_motion: Array, variance: Array
    ) -> None:
        joints, count = len(lost_motion), q.shape[1]
        self.pose = Pose(q, q[1:].copy(), np.zeros(count))
        self.lost_motion = np.repeat(lost_motion, count, axis=1)
        self.rate_error = np.zeros((joints, count))
        self._half, self._wide = resolution / 2, resolution / 2 + noise
        self._noise, self._variance = noise[1:], variance
        self._is_noisy = self._noise > 0
        self._unmodelled = UNMODELLED_SPREAD_RAD**2 + (NOISE_SHARE * self._noise) ** 2
        self._cov = np.zeros((3, 3, joints, count))
        self._cov[0, 0] = variance + (LOST_SPREAD * lost_motion) ** 2
        self._cov[1, 1] = (LOST_SPREAD * lost_motion) ** 2
        self._cov[2, 2] = RATE_SPREAD**2
        self._rigid = np.repeat(lost_motion == 0, count, axis=1)
        self._way = np.zeros((joints, count))
        self._is_pushed = self._rigid.copy()
        # Of a resting joint: mean of its readings (without noise the last), and its variance.
        self._rest = q[1:].copy()
        self._rest_variance = np.where(self._is_noisy, UNKNOWN_VARIANCE, np.zeros_like(self._rest))
        self._has_jumped = np.zeros((joints, count), dtype=bool)
        self._last_turn = np.zeros((joints, count))
        self._settling = np.zeros((joints, count))

    def take_forecast(self, pose: Pose) -> None:
        """Replace the estimated positions by their forecast `pose`, and advance the covariance."""
        moved = pose.axis - self.pose.axis
        way = np.where(moved == 0, self._way, np.sign(moved))
        self._settling = (SETTLING_SHARE * (moved - self._last_turn)) ** 2
        self._last_turn = moved
        rests = ~self._rigid & (way != self._way)
        known = np.clip(self._along()[1], 0.0, self._noise**2)
        self._rest_variance = np.where(self._is_pushed & rests, known, self._rest_variance)
        self._rest_variance = self._rest_variance + (REST_SHARE * self._noise) ** 2
        self._is_pushed &= ~rests
        self._way, self.pose = way, pose
        step = moved / (1 + self.rate_error)
        self._cov[0] += step * self._cov[2]
        self._cov[:, 0] += step * self._cov[:, 2]
        self._cov[0, 0] += self._unmodelled

    def _along(self) -> tuple[Array, Array]:
        """Return the covariance of the states with the position to which an axis pushes its joint,
        (3, N−1, S), and the variance of that position, (N−1, S)."""
        row = np.stack([np.ones_like(self._way), -self._way, np.zeros_like(self._way)])
        along = np.einsum("abjs,bjs->ajs", self._cov, row)
        return along, np.einsum("ajs,ajs->js", along, row)

    def _rest_at(self, seen: Array, lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Update the positions of resting joints; return which readings show a push, (N−1, S)."""
        spread = np.sqrt(self._rest_variance + self._noise**2)
        beyond = EXACT_READING_SPREAD + PUSHED_SPREADS * spread
        change = seen - self._rest
        is_pushed = self._way * change > self._half[1:] + beyond
        gain = self._rest_variance / np.where(self._is_noisy, spread**2, 1.0)
        rest = np.where(self._is_noisy, self._rest + gain * change, seen)
        self._rest = np.where(lost, self._rest, rest)
        self._rest_variance = np.where(lost, 1.0, 1.0 - gain) * self._rest_variance
        return is_pushed

    def _without_jumps(self, measured: Array) -> Array:
        """Return the readings (N, S) with NaN for each that no motion of its joint explains; of two
        such in a row only for the first."""
        spread = np.sqrt(self._rest_variance + self._variance)
        most = self._wide[1:] + PUSHED_SPREADS * spread + 2 * np.abs(self._last_turn)
        off = np.abs(measured[1:] - self._rest)
        self._has_jumped = self._is_noisy & ~self._has_jumped & (off > most)
        return np.concatenate([measured[:1], np.where(self._has_jumped, np.nan, measured[1:])])

    def read(self, measured: Array) -> None:
        """Update the estimate with encoder readings (N, S); NaN stands for a lost reading."""
        measured = self._without_jumps(measured)
        seen, lost = measured[1:], np.isnan(measured[1:])
        self._is_pushed |= self._rest_at(seen, lost)
        surprise = np.where(lost, 0.0, seen - (self.pose.axis - self._way * self.lost_motion))
        late = ~self._is_pushed & (self._way * surprise < 0)
        self._filter(surprise, self._is_pushed & ~lost, late)
        axis, q = self.pose.axis, self.pose.q.copy()
        rest = np.where(self._is_noisy, self._rest, q[1:])
        q[1:] = np.where(self._is_pushed, axis - self._way * self.lost_motion, rest)
        inside = np.clip(q, measured - self._wide, measured + self._wide)
        inside = np.where(np.isnan(measured), q, inside)
        together = self._is_pushed | (self._way == 0)
        axis = axis + np.where(together, inside[1:] - q[1:], 0.0)
        self.pose = Pose(inside, axis, self.pose.side)
        self._rest = np.where(self._is_noisy & self._is_pushed, inside[1:], self._rest)

    def _filter(self, surprise: Array, pushed: NDArray[np.bool_], late: NDArray[np.bool_]) -> None:
        """Correct the estimates of axis, lost motion and ε by the Kalman filter.

        Args:
            surprise: Reading of each joint minus the position to which its axis should have pushed
                it, (N−1, S).
            pushed: Whether the axis pushes the joint, (N−1, S).
            late: Whether the joint rests although its axis should push it by now, (N−1, S). Such a
                reading, or an implausible one, corrects the estimate but not its covariance.
        """
        along, spread = self._along()
        noise = self._variance + self._settling
        fits = np.abs(surprise) <= FITTING_SPREADS * np.sqrt(spread + noise)
        exact = pushed & fits
        gain = along / np.where(exact, spread + noise, spread)
        step = np.where(pushed | late, gain * surprise, 0.0)
        step[1:] = np.where(pushed & ~fits, 0.0, step[1:])
        step[0] = np.where(pushed & ~fits, surprise, step[0])
        self.pose = Pose(self.pose.q, self.pose.axis + step[0], self.pose.side)
        self.lost_motion = np.maximum(self.lost_motion + step[1], 0.0)
        self.rate_error = self.rate_error + step[2]
        self._cov -= np.where(exact, gain[:, None] * along[None], 0.0)


class History:
    """Commands sent to S samples, tick by tick from the first reading on.

    Args:
        tick: Length of a tick, s.
        first: Commands of the first ticks, (m, 2), the same for all samples.
        count: Number of samples S.
    """

    def __init__(self, tick: float, first: Array, count: int) -> None:
        self._tick, self._first = tick, 0
        self._values: list[Array] = []
        self._travel = [np.zeros((2, count))]
        self.append(np.repeat(first[:, :, None], count, axis=2))

    @property
    def last(self) -> Array:
        """The command at the latest tick, (2, S), rad/s; zero before the first."""
        return self._values[-1] if self._values else np.zeros_like(self._travel[0])

    def append(self, values: Array) -> None:
        """Add the commands of the next m ticks, (m, 2, S), rad/s."""
        for value in values:
            self._values.append(value)
            self._travel.append(self._travel[-1] + self._tick * value)

    def ticks(self, first: int, count: int) -> Array:
        """Return the commands of `count` ticks from number `first` on, (count, 2, S); then zero."""
        none = np.zeros_like(self._travel[0])
        first -= self._first
        values = self._values[first : first + count]
        return np.stack(values + [none] * (count - len(values)))

    def forget(self, time: float) -> None:
        """Drop the commands of ticks that ended before `time`, s, to save memory."""
        count = max(0, int(time // self._tick) - 1 - self._first)
        del self._values[:count], self._travel[:count]
        self._first += count

    def travel(self, times: Array) -> Array:
        """Return each motor's travel, (2, S), rad, commanded up to its entry of `times` (2,), s."""
        if not self._values:
            return self._travel[0]
        end = self._first + len(self._values)
        position = np.clip(times / self._tick, self._first, end)
        whole = np.minimum(np.floor(position + 1e-9).astype(int), end - 1)
        out = []
        for i, (k, x) in enumerate(zip(whole, position, strict=True)):
            place = k - self._first
            out.append(self._travel[place][i] + (x - k) * self._tick * self._values[place][i])
        return np.stack(out)


class Forecast:
    """Model of the nominal machine that predicts the positions of S samples.

    Args:
        system: The system.
        play: Whole play of motor 1, rad.
        tick: Longest step of integration, s.
    """

    def __init__(self, system: TriangularSystem, play: float, tick: float) -> None:
        self._half, self._tick, self.rates = play / 2, tick, system.rates

    def __call__(
        self, known: StateEstimate, done: Array, until: Array, history: History, passing: Array
    ) -> Pose:
        """Predict the positions of S samples after their motors have executed further commands.

        Args:
            known: The state estimated for the times `done`.
            done: Times until which the motors' commands have been executed, (2,), s.
            until: Times until which the motors' commands will be executed, (2,), s.
            history: The commands, from the first reading at time 0 on.
            passing: Fraction of the ideal rates that the mean arm's contacts transmit, (N−1, 1).
        """
        pose = known.pose
        count = max(1, int(np.ceil(np.max(until - done) / self._tick - 1e-9)))
        before, rate = history.travel(done), passing * (1 + known.rate_error)
        for part in np.arange(1, count + 1) / count:
            after = history.travel(done + part * (until - done))
            pose = self.predict(pose, after - before, known.lost_motion, rate)
            before = after
        return pose

    def predict(self, pose: Pose, travel: Array, lost: Array, rate: Array) -> Pose:
        """Predict the positions of S samples after both motors have turned by given travels.

        Args:
            pose: Positions before the motors turn.
            travel: Travel of the motors, (2, S), rad.
            lost: Lost motion of each joint, (N−1, S).
            rate: 1 + ε of each joint, (N−1, S).
        """
        moved = pose.side + travel[0]
        side = np.clip(moved, -self._half, self._half)
        past = np.stack([moved - side, travel[1]], axis=-1)
        middle = pose.q.T + self.rates(pose.q.T, past) / 2
        change = self.rates(middle, past).T
        q, axis = pose.q + change, pose.axis + rate * change[1:]
        q[1:] = np.clip(pose.q[1:], axis - lost, axis + lost)
        return Pose(q, axis, side)
