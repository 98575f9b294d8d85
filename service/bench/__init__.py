"""Measurements of the service itself: a made-up archive and simulated workers in, times out."""
