"""What measures glpath, and what draws the papers' figures: of a checkout, not of an installation."""
