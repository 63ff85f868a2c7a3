"""Types of arguments, for annotations."""

from rtamt.inputs.samples import NanPolicy
from rtamt.machines.protocols import End
from rtamt.program.interface import Names, SemanticsName
from rtamt.program.timing import Align, Period

__all__ = ["Align", "End", "Names", "NanPolicy", "Period", "SemanticsName"]
