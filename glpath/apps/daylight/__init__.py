"""Annual daylight: visibility of sky and sun from many points along common directions."""
