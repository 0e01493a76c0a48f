"""A project of image tests, written for pytest-mpl and for glpath; the bench `image-tests` runs both."""
