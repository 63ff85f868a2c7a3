"""The costs of steps on arrays: `rtamt_gym.judging.costs` says what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rtamt import Specification
from rtamt_arrays.monitors import ArrayMonitors
from rtamt_arrays.online import OnlineReading, OnlineState
from rtamt_arrays.operations import Operations, Tensor
from rtamt_gym.judging.costs import Cost, Demand, keyed_costs, measured_demands, step_costs
from rtamt_gym.judging.monitors import options_of_parts
from rtamt_gym.options.evaluation import EvaluationOptions

__all__ = ["ArrayCosts", "CostState"]


class CostState(NamedTuple):
    """What is known of costs.

    Attributes:
        monitors: The state of the monitor of each demand.
        charged: With ``"first"``, 1 where a specification was violated before the step, a row for
            each.
    """

    monitors: tuple[OnlineState, ...]
    charged: Tensor


class ArrayCosts:
    """`rtamt_gym.judging.costs.VectorCostMeter` as pure functions of arrays.

    Args:
        kind: What is measured; None: nothing.
        specs: Specifications by name.
        reading: How samples are judged.
        monitors: Makes the monitors.
        operations: The operations of the array library.

    Attributes:
        keys: The keys of the infos.

    Raises:
        SpecificationError: As `rtamt_gym.judging.costs.demands_of` does.
    """

    def __init__(
        self,
        kind: Cost | None,
        specs: Mapping[str, Specification],
        reading: EvaluationOptions,
        monitors: ArrayMonitors,
        operations: Operations,
    ) -> None:
        self._kind = kind
        self._names = list(specs)
        self._o = operations
        self._demands = [] if kind is None else measured_demands(kind, specs, reading)
        options = options_of_parts(specs, [each.spec for each in self._demands], reading)
        self._monitors = [
            monitors.online(demand.spec, option["period"], align=option["align"])
            for demand, option in zip(self._demands, options, strict=True)
        ]
        self.keys = frozenset[str]()
        if kind is not None:
            self.keys = frozenset(keyed_costs(self._names, [0.0] * (len(self._names) + 1)))

    def init(self, lanes: int, dtype: object) -> CostState:
        """The state before the first sample."""
        monitors = tuple(monitor.init(lanes) for monitor in self._monitors)
        rows = len(self._names) if self._kind == "first" else 0
        return CostState(monitors, self._o.full((rows, lanes), 0.0, dtype))

    def reset(self, state: CostState, mask: Tensor) -> CostState:
        """Return the state in which the lanes of the mask have not taken a sample."""
        pairs = zip(self._monitors, state.monitors, strict=True)
        monitors = tuple(monitor.reset(each, mask) for monitor, each in pairs)
        return CostState(monitors, self._o.where(mask, 0.0, state.charged))

    def begin(self, state: CostState, sample: Mapping[str, Tensor], mask: Tensor) -> CostState:
        """Lanes of the mask begin with a sample, which costs nothing."""
        pairs = zip(self._monitors, state.monitors, strict=True)
        begun = [monitor.begin(each, sample, mask) for monitor, each in pairs]
        charged = self._o.where(mask, 0.0, state.charged)
        return CostState(tuple(each for each, _ in begun), charged)

    def take(
        self, state: CostState, sample: Mapping[str, Tensor], at: Tensor, zero: Tensor
    ) -> tuple[CostState, list[Tensor]]:
        """Every lane takes a sample; gives what the demands of each specification come to.

        Args:
            state: What `init`, `begin` or `charge` gave.
            sample: An array of shape (lanes,) for each variable.
            at: The number of the sample.
            zero: A zero of each lane.
        """
        monitors, worst = [], [zero] * len(self._names)
        for demand, monitor, each in zip(
            self._demands, self._monitors, state.monitors, strict=True
        ):
            following, reading = monitor.update(each, sample)
            monitors.append(following)
            cost = self._cost(demand, reading, at - monitor.latency, zero)
            worst[demand.place] = self._o.greater(worst[demand.place], cost)
        return state._replace(monitors=tuple(monitors)), worst

    def charge(
        self, state: CostState, worst: Sequence[Tensor], violated: Sequence[Tensor]
    ) -> tuple[CostState, dict[str, Tensor]]:
        """The keys of the infos of a step.

        Args:
            state: What `take` gave.
            worst: What `take` gave.
            violated: 1 where each specification is violated, the reading of an end included.
        """
        if self._kind is None:
            return state, {}
        before = [state.charged[place] for place in range(state.charged.shape[0])]
        costs = keyed_costs(self._names, step_costs(self._kind, worst, violated, before))
        return state._replace(charged=self._o.stack(violated)) if before else state, costs

    def _cost(
        self, demand: Demand, reading: OnlineReading, instant: Tensor, zero: Tensor
    ) -> Tensor:
        """What it costs that an instant violates a demand; 0 where it does not."""
        value = reading.robustness
        charged = self._o.signbit(value) & ~self._o.isnan(value) & (instant >= demand.first)
        if demand.last is not None:
            charged = charged & (instant <= demand.last)
        return self._o.where(charged, zero + 1.0 if self._kind == "violation" else -value, zero)
