"""Navigation methods, one folder per paper, each reading like its paper."""
