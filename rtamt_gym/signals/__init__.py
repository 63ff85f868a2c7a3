"""Signals: from text such as ``obs[2]`` to numbers."""
