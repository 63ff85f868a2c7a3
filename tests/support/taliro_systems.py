"""Systems of psy-taliro that a file can name: ``taliro_systems:decay``."""

import staliro

from rtamt_gym.search.falsification.taliro import TaliroSystem


@staliro.model  # type: ignore[untyped-decorator]  # it has no types here
def _decay(inputs: staliro.Inputs[staliro.Sample]) -> staliro.Trace[dict[str, float]]:
    height, rate = inputs.static["height"], inputs.static["rate"]
    return staliro.Trace({0.5 * i: {"x": height * (1 - rate) ** i} for i in range(9)})


decay = TaliroSystem(
    _decay,
    staliro.TestOptions(static_inputs={"height": (0.0, 9.0), "rate": (0.0, 1.0)}),
    period=0.5,
)
