"""Sample models in Khronos' layout, rendered beside Cycles."""
