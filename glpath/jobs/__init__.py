"""Robust and distributed renders on top of `glpath.rendering`: checkpoints, a watchdog, shards, clusters.

checkpoint  film on disk while it is rendered, from which a render resumes
shards      merging of films of ranges of path sets, each counted once
watchdog    detection of a device or solver that hangs
cluster     one render by the workers of a cluster
connection  connection to the workers of a cluster
worker      code that a worker runs
chunks      scheduler that decides which path sets a worker gets next
"""
