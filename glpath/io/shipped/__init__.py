"""Scenes that glpath brings along: files by name, and scenes that a program makes from parameters."""
