"""The module from which programs of the released library take its exception."""

from rtamt.compat import RTAMTException
