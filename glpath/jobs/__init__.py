"""Renders that survive: checkpoints, a watchdog, shards that are merged; over `glpath.rendering`.

checkpoint  the film on disk while it grows, and how a render goes on with it
shards      films of ranges of path sets, merged once each
watchdog    notices a device or a solver that hangs
"""
