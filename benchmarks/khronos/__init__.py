"""Sample models in the layout of Khronos, rendered by glpath and Cycles."""
