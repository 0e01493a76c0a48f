"""Skies and the sun: radiance by direction, and the position of the sun."""
