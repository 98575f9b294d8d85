"""Integrity of an archive: check and repair."""
