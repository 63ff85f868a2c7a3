"""Monitors for other tools: functional mock-up units (FMUs)."""

from typing import Literal

__all__ = ["Fmi"]

Fmi = Literal[2, 3]
"""The version of FMI: 2.0 or 3.0."""
