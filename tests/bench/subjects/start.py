"""Print times of a new process in ms: imports, the first parse, large formulas.

Arguments: nothing, or the modules (JSON) of the first parse, to be loaded before it.
"""

import json
import sys
import time

begin = time.perf_counter()
seen: dict[str, float] = {}


def lap(name: str) -> None:
    """Record the time since the last lap under a name."""
    global begin  # noqa: PLW0603 - a script, and nothing may run between two laps
    seen[name] = (time.perf_counter() - begin) * 1e3
    begin = time.perf_counter()


THIRTEEN = (
    "always((req >= 3) implies eventually[0:{i}](gnt >= 3))"
    " and ((a > 0) until[0:7] (b < 2)) and not once[0:9](a + b > {i})"
    " or historically((x > 1) since[2:5] (y > x)) and (rise(a > 2) iff fall(b > 1)) xor next(x > 0)"
)

import numpy  # noqa: E402, F401, ICN001 - timed

lap("numpy")
import rtamt  # noqa: E402 - timed

lap("rtamt")
before = set(sys.modules)
for module in json.loads(sys.argv[1]) if len(sys.argv) > 1 else ():
    __import__(module)
lap("parser")
rtamt.parse("always[0:5](a + b > -2)")
lap("first parse")
modules = [name for name in sys.modules if name not in before]

for i in range(20, 30):
    text = THIRTEEN.format(i=i)
    begin = time.perf_counter()
    rtamt.parse(text)
    lap(f"13 operators {i}")
seen["13 operators"] = min(seen.pop(f"13 operators {i}") for i in range(20, 30))

text = " and ".join(f"(x > {i})" for i in range(10_000))
begin = time.perf_counter()
rtamt.parse(text)
lap("10,000 conjuncts")
text = "(" * 10_000
begin = time.perf_counter()
try:
    rtamt.parse(text)
except rtamt.ParseError:
    lap("10,000 open brackets")

print(json.dumps({"ms": seen, "modules": modules}))
