"""Witnesses that share no code with the engines: closed forms, and a slow path tracer in numpy."""
