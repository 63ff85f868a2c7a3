"""Classes of messages, as packages for robots define them."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace


@dataclass
class Vector:
    x: float = 0.0
    y: float = 0.0


@dataclass
class Twist:
    linear: Vector = field(default_factory=Vector)
    angular: Vector = field(default_factory=Vector)
    stamp: str = "now"


class Slotted:
    __slots__ = ("near", "value")

    def __init__(self) -> None:
        self.value = 1.0
        self.near = 1.0


@dataclass(frozen=True)
class Frozen:
    value: float = 0.0


MODULES: dict[str, object] = {
    "geometry": SimpleNamespace(Twist=Twist),
    "results": SimpleNamespace(Slotted=Slotted, Frozen=Frozen, Anything=3),
}
