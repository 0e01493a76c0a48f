"""Helpers of several test modules: scenes, files of all formats, programs to start and kill."""
