"""One project of image tests twice, by pytest-mpl and by glpath: what the bench `image-tests` runs."""
