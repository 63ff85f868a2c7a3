"""The module of the released library's enumeration of io types."""

from rtamt.compat import StlIOType
