"""Machines that run programs."""
