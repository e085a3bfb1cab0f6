"""Compiled functions on arrays and scalars: no classes, no errors, no files."""
