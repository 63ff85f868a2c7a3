"""The ``EnvSpec`` of an environment with a callable signal."""

from __future__ import annotations

from dataclasses import fields

from gymnasium.envs.registration import EnvSpec

from rtamt import InputError

__all__ = ["CallableSpec"]


class CallableSpec(EnvSpec):
    """An ``EnvSpec`` with a callable signal: for `gym.make`, not for JSON."""

    @classmethod
    def of(cls, spec: EnvSpec) -> CallableSpec:
        """The same specification of an environment, without JSON."""
        return cls(
            **{field.name: getattr(spec, field.name) for field in fields(spec) if field.init}
        )

    def to_json(self) -> str:
        """Refuses to write JSON, and names the signal.

        Raises:
            InputError: Whenever a signal is a callable.
        """
        for wrapper in self.additional_wrappers:
            signals = (wrapper.kwargs or {}).get("signals")
            for name, signal in signals.items() if isinstance(signals, dict) else ():
                function = signal[0] if isinstance(signal, list | tuple) else signal
                if callable(function):
                    raise InputError(
                        f"signal {name!r} is a callable, which JSON cannot hold; use a selector "
                        'such as "obs[0]", or pass env.spec itself to gym.make'
                    )
        return super().to_json()
