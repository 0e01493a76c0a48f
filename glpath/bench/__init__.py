"""Measurements beside other people's programs; each module is one peer or one `glpath bench NAME`."""
