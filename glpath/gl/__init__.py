"""All that knows moderngl: the context, programs, passes and what a scene is on the GPU."""
