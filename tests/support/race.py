"""Step one unit in two threads at once, which FMI forbids: ThreadSanitizer must report the race.

Run: python tests/support/race.py, with the runtime of ThreadSanitizer in the process.
"""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Barrier

from fmu_calls import sampled, unit, write

SAMPLES = 1e6  # in a step, so that the steps of two threads overlap

if __name__ == "__main__":
    ready = Barrier(2)
    with TemporaryDirectory() as folder, unit(2, write(Path(folder), sampled("x > 0"))) as made:
        made.begin()

        def step() -> None:
            ready.wait()
            made.step(0.0, SAMPLES)

        with ThreadPoolExecutor(2) as pool:
            for each in [pool.submit(step) for _ in range(2)]:
                each.result()
