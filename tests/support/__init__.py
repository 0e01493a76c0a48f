"""What several test modules stand on: scenes, files of all formats, programs that are started and killed."""
