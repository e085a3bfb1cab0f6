"""Uncertainty fields on disk."""
