"""Trade-off curves: what less sensitivity costs in effort, duration or peak input.

In reading order: `knee`, `point` (one plan of the curve), `axis` (what is limited, and over which
range), `store` (a folder that keeps finished points), `curve` (the whole).
"""

from planner.pareto.curve import TradeOff, trade_off
from planner.pareto.point import Point

__all__ = ["Point", "TradeOff", "trade_off"]
