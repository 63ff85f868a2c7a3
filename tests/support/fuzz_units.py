"""The units that fuzzers call, `tests/fuzz/programs/NAME/program.rtamt`, in the current format.

Run after a change of the format: python tests/support/fuzz_units.py
"""

from __future__ import annotations

from fmu_calls import dense, sampled, write
from paths import ROOT

from rtamt.export.program_file import Programs

FOLDER = ROOT / "tests" / "fuzz" / "programs"

TEXTS = {
    "samples": """
        const float limit = 3
        near = historically[1:4](x < 2 * limit) and prev(y > 0)
        done = eventually always(y > 2)
        done and always(x > limit implies eventually[0:4] always[1:3](y > sqrt(limit)))
    """,
    "neutral": """
        input float x
        output float y
        always[2:6]((y > 0) until[0:3] (x > 0)) or eventually once[0:3](y < -1)
    """,
    "dense": """
        const float limit = 3
        near = once[0:3](x > -limit)
        done = eventually always(y > 2)
        always((x < 1) since[0:3] (y > limit)) or done
    """,
}


def programs(name: str) -> Programs:
    """Return the programs of a unit with two inputs."""
    if name == "dense":
        return dense(TEXTS[name])
    return sampled(TEXTS[name], semantics="output-vacuity" if name == "neutral" else "standard")


if __name__ == "__main__":
    for name in TEXTS:
        folder = FOLDER / name
        folder.mkdir(parents=True, exist_ok=True)
        write(folder, programs(name))
