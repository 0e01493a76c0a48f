"""The papers' structures, each usable alone."""
