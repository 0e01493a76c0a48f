"""Renders that survive, and that many share: checkpoints, a watchdog, shards, clusters; over `glpath.rendering`.

checkpoint  the film on disk while it grows, and how a render resumes from it
shards      films of ranges of path sets, merged once each
watchdog    notices a device or a solver that hangs
cluster     one render by the workers of a cluster: `connection` has these, `worker` is what they run, `chunks` says
            which path sets to hand out next
"""
