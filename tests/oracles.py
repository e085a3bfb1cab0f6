"""Slow, obvious twins of the kernels: plain Python, no cleverness. Randomised tests compare them."""

from __future__ import annotations
