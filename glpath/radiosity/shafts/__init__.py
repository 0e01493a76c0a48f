"""Occluders between two surfaces [SC]: shafts, candidate lists, and casting rays through them."""
