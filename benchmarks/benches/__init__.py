"""Measurements, compared with other programs if they are installed; each module is one bench."""
