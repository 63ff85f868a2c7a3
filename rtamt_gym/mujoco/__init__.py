"""Monitors inside loops of ``mj_step``."""
