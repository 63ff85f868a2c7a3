"""`SavedCase`: a case of a system in a file, with its expected result."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Self

import gymnasium as gym

import rtamt
from rtamt import InputError, Specification, Verdict
from rtamt.errors import nearest
from rtamt.renamed import OldName
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.options.evaluation import names_for
from rtamt_gym.play.run import Run
from rtamt_gym.play.runner import Runner
from rtamt_gym.play.simulate import simulate
from rtamt_gym.results.codec import check_name, document, plain, read_as
from rtamt_gym.results.outcome import violated_by_end
from rtamt_gym.results.provenance import Fingerprint, check_unchanged, versions_in_use
from rtamt_gym.results.trial import Trial
from rtamt_gym.systems.fingerprints import fingerprint_of
from rtamt_gym.systems.policies import policy_of
from rtamt_gym.systems.registry import (
    import_path,
    named_object,
    named_system,
    policy_text,
    system_name,
    system_texts,
)

_READING: Final = tuple(name for name in names_for("runs") if name != "period")

_KEYS: Final = (
    *("format", "version", "kind", "rtamt", "system", "requirement", "case", "seed"),
    *("duration", "period", "signals", "policy", "reading", "expected", "versions"),
)
"""The required keys of a file."""

_TYPES: Final[Mapping[str, tuple[Any, str]]] = {
    "system": (dict, "an object of JSON"),
    "seed": (int | None, "a whole number, 0 or more, or null"),
    "signals": (dict | None, "an object of JSON or null"),
    "policy": (str | None, "text or null"),
    "versions": (dict, "an object of JSON"),
}
"""Types that are checked here, where errors name the file."""


@dataclass(frozen=True, kw_only=True)
class SavedCase:
    """One case of a system with a requirement, and its outcome; `load` reads one.

    A case is code of its author, as a pickle is. Loading never executes code, but `replay` imports
    and runs the modules, policies, models and FMUs that the file names, `imports`. Replay a case
    only if you would run a program of its author.

    `Falsification.save` writes strict JSON, with the strings ``"inf"`` and ``"-inf"`` for
    infinities. ``rtamt replay case.json`` runs it.

    Attributes:
        system: The reference to the system: ``{"environment": ID}``, with ``"arguments"`` and
            ``"steps"`` that differ from the registered ones; ``{"fmus": {NAME: PATH}}`` with the
            arguments of `Fmus` and paths relative to the file; or ``{"object": "module:name"}``,
            the system or a function without arguments that makes it.
        name: The name of the requirement.
        requirement: The requirement.
        case: The case of the simulation.
        seed: The seed of an environment's reset, or None.
        signals: The selectors of the variables, or None.
        policy: The name of the policy, as ``rtamt run --policy`` takes it, or None.
        period: As for `rtamt_gym.simulate`.
        duration: As for `rtamt_gym.simulate`.
        evaluation_options: Evaluation options of `rtamt_gym.simulate`.
        robustness: The robustness of the run, which was stopped at its certain violation.
        verdict: The verdict of the run.
        versions: The versions of Python and of the packages that it ran with.
        fingerprint: Hashes and versions of the system and the policy; None in older files.
        folder: The folder of the file; paths are relative to it.
    """

    system: Mapping[str, Any]
    name: str
    requirement: Specification
    case: Case
    seed: int | None
    signals: Mapping[str, Any] | None
    policy: str | None
    period: float | str | None
    duration: float | None
    evaluation_options: Mapping[str, Any]
    robustness: float
    verdict: Verdict
    versions: Mapping[str, str]
    folder: Path = field(compare=False)
    fingerprint: Fingerprint | None = None

    reading = OldName("evaluation_options")

    @classmethod
    def of(
        cls,
        runner: Runner,
        name: str,
        row: Trial,
        folder: Path,
        *,
        system: str | None = None,
        policy: str | None = None,
    ) -> Self:
        """Return the case of a simulation that a runner has made.

        ``folder`` is the folder of the file. ``system`` and ``policy`` name the system, as
        ``module:name``, and the policy; by default, the names are derived.

        Raises:
            InputError: If a file can hold no name of the system, the policy or a signal.
        """
        options = runner.options
        outcome = row.outcomes[name]
        saved = cls(
            system=system_name(runner.system, folder) if system is None else {"object": system},
            name=name,
            requirement=runner.requirements[name],
            case=row.case,
            seed=row.seed,
            signals=_checked_signals(options.get("signals")),
            policy=_policy_name(options.get("policy"), policy),
            period=options.get("period"),
            duration=options.get("duration"),
            evaluation_options={
                name: _listed(value)
                for name, value in runner.evaluation_options.about(name).options().items()
                if name != "period" and value not in (None, False)
            },
            robustness=outcome.robustness,
            verdict=outcome.verdict,
            versions=versions_in_use(),
            folder=folder,
        )
        try:
            return replace(saved, fingerprint=saved.current())
        except Exception:  # noqa: BLE001 - a name that cannot be opened here, as `replay` reports
            return saved

    @property
    def imports(self) -> tuple[str, ...]:
        """The code that `replay` runs: ``os``, ``gymnasium (CartPole-v1)``, ``a.fmu``."""
        policy = [] if self.policy is None else [policy_text(self.policy)]
        return tuple(dict.fromkeys(filter(None, [*system_texts(self.system), *policy])))

    def replay(self, *, accept_changed: bool = False) -> Run:
        """Run the case, and so the code that it names, until a violation is certain.

        Args:
            accept_changed: Whether to run it although the system, its source, its policy, rtamt or
                the simulator has changed since it was saved, as a regression test does.

        Raises:
            InputError: If the system or policy does not exist or has changed; the error lists the
                names in the file.
            RtamtError: As `rtamt_gym.simulate` does.
        """
        with self._opened() as (system, policy):
            if self.fingerprint is not None and not accept_changed:
                changes = self.fingerprint.changes(fingerprint_of([system], [policy]))
                check_unchanged("the case", changes, "save a new case")
            return simulate(
                system,
                {self.name: self.requirement},
                self.signals,
                case=self.case,
                seed=self.seed,
                policy=policy,
                period=self.period,
                duration=self.duration,
                **self.evaluation_options,
            )

    def current(self) -> Fingerprint:
        """Return the fingerprint of the system and the policy as they are now; makes both.

        Raises:
            InputError: If the system or policy does not exist.
        """
        with self._opened() as (system, policy):
            return fingerprint_of([system], [policy])

    @contextmanager
    def _opened(self) -> Iterator[tuple[Any, Any]]:
        """Yield the system and the policy that the case names."""
        system = named_system(self.system, self.folder)
        with ExitStack() as stack:
            if isinstance(system, gym.Env):
                stack.callback(system.close)
            policy: Any = None
            if self.policy is not None and isinstance(system, gym.Env):
                policy = policy_of(self.policy, system)(self.seed or 0)
            elif self.policy is not None:
                policy = named_object(self.policy)
            yield system, policy

    def gives(self, run: Run) -> bool:
        """Return whether a run has the expected verdict."""
        return run.histories[self.name].verdict is self.verdict

    def repeats(self, run: Run) -> bool:
        """Return whether a run has the expected verdict and robustness, to the last bit."""
        final = run.histories[self.name].final
        same = final == self.robustness and math.copysign(1, final) == math.copysign(
            1, self.robustness
        )
        return self.gives(run) and (same or (math.isnan(final) and math.isnan(self.robustness)))

    def newer(self) -> dict[str, tuple[str, str]]:
        """Return the saved and the present versions of packages that differ."""
        now = versions_in_use()
        return {
            name: (then, now[name])
            for name, then in self.versions.items()
            if name in now and now[name] != then
        }

    def to_json(self) -> str:
        """Return the case as strict JSON."""
        requirement = {"name": self.name, "text": str(self.requirement)}
        if self.requirement.unit != "s":
            requirement["unit"] = self.requirement.unit
        content = {
            "system": dict(self.system),
            "requirement": requirement,
            "case": self.case,
            "seed": self.seed,
            "duration": self.duration,
            "period": self.period,
            "signals": None if self.signals is None else dict(self.signals),
            "policy": self.policy,
            "reading": dict(self.evaluation_options),
            "expected": {
                "verdict": self.verdict,
                "robustness": self.robustness,
                **({"by_end": True} if violated_by_end(self.verdict, self.robustness) else {}),
            },
            "versions": dict(self.versions),
            **({} if self.fingerprint is None else {"fingerprint": plain(self.fingerprint)}),
        }
        return document("case", content) + "\n"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the case to a file with a name that ends in ``.json``.

        Raises:
            InputError: If it ends in something else.
        """
        check_name(path)
        Path(path).write_text(self.to_json(), encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file that `save` has written.

        Raises:
            InputError: If it holds no case.
            OSError: If the file does not exist.
        """
        return read_as(path, "case", lambda stored: cls(**_read(stored), folder=Path(path).parent))


def _read(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a case from JSON."""
    _check_keys("a case", stored, _KEYS, ("fingerprint",))
    requirement, expected = stored["requirement"], stored["expected"]
    _check_keys('"requirement"', requirement, ("name", "text"), ("unit",))
    _check_keys('"expected"', expected, ("verdict", "robustness"), ("by_end",))
    _check_keys('"reading"', stored["reading"], (), _READING)
    for key, (types, phrase) in _TYPES.items():
        if not isinstance(stored[key], types) or isinstance(stored[key], bool):
            raise InputError(f'expected "{key}" as {phrase}, got {stored[key]!r}')
    if stored["seed"] is not None and stored["seed"] < 0:
        raise InputError(f'expected "seed" as {_TYPES["seed"][1]}, got {stored["seed"]}')
    if expected["verdict"] not in Verdict.__members__:
        raise InputError(
            f'expected "verdict" among {listing(Verdict.__members__)}, got {expected["verdict"]!r}'
        )
    spec = rtamt.parse(requirement["text"], unit=requirement.get("unit", "s"))
    if len(spec.requirements) != 1:
        raise InputError(
            f'expected the "text" of one requirement, got {len(spec.requirements)}: '
            f"{listing(spec.requirements)}"
        )
    return {
        "system": stored["system"],
        "name": requirement["name"],
        "requirement": spec,
        "case": Case.from_json(json.dumps(stored["case"])),
        "seed": stored["seed"],
        "signals": _pairs(stored["signals"]),
        "policy": stored["policy"],
        "period": stored["period"],
        "duration": None if stored["duration"] is None else _number("duration", stored["duration"]),
        "evaluation_options": stored["reading"],
        "robustness": _number("robustness", expected["robustness"]),
        "verdict": Verdict[expected["verdict"]],
        "versions": stored["versions"],
        "fingerprint": Fingerprint.read(stored.get("fingerprint")),
    }


def _check_keys(
    name: str, stored: object, needed: Sequence[str], possible: Sequence[str] = ()
) -> None:
    if not isinstance(stored, dict):
        raise InputError(f"expected {name} as an object of JSON, got {stored!r}")
    for key in needed:
        if key not in stored:
            raise InputError(f"expected {name} with {key!r}, got {listing(stored)}")
    for key in stored:
        if key not in (*needed, *possible):
            raise InputError(
                f"expected {name} with {listing([*needed, *possible])}, got {key!r}"
                f"{nearest(key, [*needed, *possible])}"
            )


def _number(name: str, value: Any) -> float:  # noqa: ANN401 - of JSON
    if value in ("inf", "-inf", "nan") or (
        isinstance(value, int | float) and not isinstance(value, bool)
    ):
        return float(value)
    raise InputError(f'expected "{name}" as a number, got {value!r}')


def _pairs(signals: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return signals with pairs as tuples, which JSON stores as lists."""
    if signals is None:
        return None
    return {
        name: tuple(signal) if isinstance(signal, list) else signal
        for name, signal in signals.items()
    }


def _listed(value: Any) -> Any:  # noqa: ANN401 - an option
    """Return an option for JSON: several names are a list."""
    return value if isinstance(value, str | bool) else list(value)


def _checked_signals(signals: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    for name, signal in (signals or {}).items():
        if any(
            callable(part) for part in (signal if isinstance(signal, list | tuple) else [signal])
        ):
            raise InputError(
                f"cannot save a case: signal {name!r} is a function; use a selector, such "
                f"as signals={{{name!r}: 'obs[0]'}}, or an environment that has the signal in its "
                "info"
            )
    return signals


def _policy_name(policy: object, name: str | None) -> str | None:
    if policy is None or name is not None:
        return name
    path = import_path(policy)
    if path is None:
        phrase = getattr(policy, "__qualname__", None) or f"a {type(policy).__name__}"
        raise InputError(
            f"cannot save a case with the policy {phrase}, which no other program can import; "
            'write save(path, policy="module:function"), or policy="sb3:FILE.zip" or "zero"'
        )
    return path
