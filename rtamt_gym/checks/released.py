"""Check whether the released library, also named `rtamt`, was installed over this one."""

import rtamt

__all__: list[str] = []

if "BACKEND" not in dir(rtamt):  # not hasattr, which would import the machines
    raise ImportError(
        "expected the packages of rtamt-stl, got the released rtamt, which was installed over it: "
        "pip uninstall rtamt rtamt-stl, then install rtamt-stl again"
    )
