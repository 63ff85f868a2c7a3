"""A robot and its controller as nodes, to try a monitor on."""
