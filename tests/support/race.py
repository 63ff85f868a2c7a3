"""Steps one unit in two threads at once, which FMI forbids: a race that ThreadSanitizer must see.

Run: python tests/support/race.py, with the runtime of ThreadSanitizer in the process.
"""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from fmu_calls import sampled, unit, write

if __name__ == "__main__":
    with TemporaryDirectory() as folder, unit(2, write(Path(folder), sampled("x > 0"))) as made:
        made.begin()
        with ThreadPoolExecutor(2) as pool:
            pool.map(lambda i: [made.step(float(i), 1.0) for _ in range(100)], range(2))
