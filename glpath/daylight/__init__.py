"""Sun and sky through the year: what many points see along directions that all of them share."""
