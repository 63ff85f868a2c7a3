"""Reads text by the grammar Stl.g4; `rtamt.language.parser` is the way in."""
