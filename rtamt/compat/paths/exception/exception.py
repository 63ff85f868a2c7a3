"""The module of the released library's exception."""

from rtamt.compat import RTAMTException
