"""Measurements, compared with other people's programs where they are installed; each module is one bench."""
