"""Runs many cases on processes or machines, and loses none to a kill."""
