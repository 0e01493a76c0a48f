"""What the device has no memory for is named, with its size."""

from __future__ import annotations

OUT_OF_MEMORY = (
    "Render the image in crops (--crop X,Y,W,H), whose films have their place in the whole; or take fewer pixels,\n"
    "smaller textures, or another --device."
)
